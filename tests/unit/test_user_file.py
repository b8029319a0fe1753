"""Whatever stands in place of a file is told in one line, at once."""

import os
import socket
from pathlib import Path

import pytest

from ccr_host import config
from ccr_host.errors import ConfigError
from ccr_host.robot.path_file import read_path_file
from ccr_host.run.sweep.plan import read_twins
from ccr_host.simavr.flash_image import read_flash_image
from ccr_host.tracking.aruco import load_camera_file
from ccr_host.tracking.ndi.rom import load_rom
from ccr_host.user_file import read_bytes


def read_description(file: Path) -> None:
    config.load(str(file))


READERS = [
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
def test_what_is_no_file_is_refused_without_waiting(places, read):
    for place in places:
        with pytest.raises(ConfigError) as caught:
            read(place)
        assert caught.value.cure


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize(
    "content",
    [b"", b"\0" * 1000, b"[" * 100_000, b"\xff\xfe\0", b'{"a":' * 50_000, os.urandom(5000)],
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
