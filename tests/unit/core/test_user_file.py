"""Anything that is not a file is reported in one line, at once."""

import os
import random
import socket
from pathlib import Path

import pytest

from ccr_host.core.errors import CcrError, ConfigError
from ccr_host.core.user_file import read_bytes, replacing
from ccr_host.description import schema
from ccr_host.record.log.reader import RunRecording
from ccr_host.robot.paths import read_path_file
from ccr_host.sim.board.eeprom import EepromFile
from ccr_host.sim.simavr.flash_image import read_flash_image
from ccr_host.tools.sweep.plan import read_twins
from ccr_host.tracking.sources.camera_model import load_camera_file
from ccr_host.tracking.sources.ndi.rom import dummy_passive_rom, load_rom


def read_description(file: Path) -> None:
    schema.load(str(file))


def read_log(file: Path) -> None:
    list(RunRecording(file).messages())


READERS = [
    read_log,
    read_path_file,
    read_description,
    read_twins,
    read_flash_image,
    load_camera_file,
    load_rom,
]


@pytest.fixture
def places(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    os.mkfifo("pipe")
    bound = socket.socket(socket.AF_UNIX)
    bound.bind("socket")
    Path("loop").symlink_to("loop")
    Path("dangling").symlink_to("nowhere")
    Path("folder").mkdir()
    yield [
        *map(Path, ("pipe", "socket", "loop", "dangling", "folder", "missing", "a\0b", "x" * 300)),
        *map(Path, ("/dev/zero", "/dev/null", "/dev/stdin", "loop/x", "dangling/x")),
        Path(os.fsdecode(b"\xff\n[bold]$x$")),
    ]
    bound.close()


@pytest.mark.parametrize("read", READERS)
def test_what_is_not_a_file_is_rejected_without_waiting(places, read):
    for place in places:
        with pytest.raises(ConfigError) as caught:
            read(place)
        assert caught.value.cure


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0" * 1000,
        b"[" * 100_000,
        b"\xff\xfe\0",
        b'{"a":' * 50_000,
        random.Random(1).randbytes(5000),
    ],
)
def test_what_is_of_another_kind_is_refused(tmp_path, read, content):
    file = tmp_path / "file.toml"
    file.write_bytes(content)
    if read is read_description and not content:
        return  # an empty description has every default
    with pytest.raises(ConfigError):
        read(file)


@pytest.mark.parametrize("read", READERS)
def test_a_file_too_long_is_not_read(tmp_path, read):
    file = tmp_path / "file.toml"
    with file.open("wb") as sparse:
        sparse.truncate(2**40)
    with pytest.raises(ConfigError, match="longer than"):
        read(file)


def test_the_longest_file_is_read_and_one_byte_more_is_not(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(bytes(10))
    assert read_bytes(file, "file", "", 10) == bytes(10)
    with pytest.raises(ConfigError, match="longer than 9 bytes"):
        read_bytes(file, "file", "", 9)


def test_a_file_of_others_is_refused(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(b"")
    file.chmod(0)
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        with pytest.raises(ConfigError, match="Permission denied"):
            read_bytes(file, "file", "", 9)
    finally:
        os.seteuid(user)


@pytest.mark.usefixtures("places")
@pytest.mark.parametrize("name", ["pipe", "socket", "folder", "a\0b", "x" * 300, "/dev/zero"])
def test_nothing_but_a_file_keeps_an_eeprom(name):
    with pytest.raises(ConfigError, match="EEPROM file"):
        EepromFile(Path(name))


SEEDS = [
    (read_path_file, b"# c\r\nt_ms;y_m;z_cm\r\n0;0,01;3\r\n100;0,02;3,5\r\n"),
    (read_path_file, "time [s]\ty (mm)\tz [mm]\n0\t1\t2\n5\t2\t3\n".encode("utf-16")),
    (
        read_description,
        b"# mine\n[twin]\nslack_mm = 0.8\n[servo]\nneutral_pulse_us = [1500, 1510]\n",
    ),
    (read_twins, b'{"twin.slack_mm": 0.8, "tracker.latency_ms": 60}\n'),
    (
        load_camera_file,
        b"camera_matrix:\n data: [1,0,1,0,1,1,0,0,1]\ndistortion_coefficients:\n data: [0,0,0,0]",
    ),
    (load_rom, dummy_passive_rom()),
    (read_flash_image, b":10010000214601360121470136007EFE09D2190140\n:00000001FF\n"),
]
PIECES = [
    b"\n",
    b"\r",
    b",",
    b'"',
    b"#",
    b"=",
    b"[",
    b"{",
    b"nan",
    b"1e999",
    b"1" * 5000,
    b"\0",
    b"\xff",
]


@pytest.mark.parametrize(("read", "content"), SEEDS)
def test_any_change_of_a_file_is_read_or_refused(tmp_path, read, content):
    draw, file = random.Random(1), tmp_path / "file.toml"
    for _ in range(150):
        data = bytearray(content)
        for _ in range(draw.choice((1, 2, 8))):
            at = draw.randrange(len(data))
            match draw.randrange(3):
                case 0:
                    data[at] = draw.randrange(256)
                case 1:
                    data[at:at] = draw.choice(PIECES)
                case _:
                    del data[at : at + draw.choice((1, 5))]
        file.write_bytes(data)
        try:
            read(file)
        except CcrError as error:
            assert error.cure


def test_drafts_of_killed_processes_are_removed_by_a_later_write_and_those_of_others_stay(tmp_path):
    left_over, of_another, own = (tmp_path / f".{n}-0.draft" for n in (4711, 4712, 4713))
    mine = tmp_path / "notes.draft"
    for file, age_s in (left_over, 7200.0), (of_another, 60.0), (own, 0.0), (mine, 7200.0):
        file.write_text("half")
        then_s = file.stat().st_mtime - age_s
        os.utime(file, (then_s, then_s))
    with replacing(tmp_path / "rows.parquet") as draft:
        draft.write_text("whole")
    assert {file.name for file in tmp_path.iterdir()} == {
        of_another.name, own.name, mine.name, "rows.parquet"
    }  # fmt: skip
