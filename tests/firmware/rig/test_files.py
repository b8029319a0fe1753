"""Program files, and the building of the shim."""

import pytest

from ccr_host.core.errors import ConfigError, DeviceError
from ccr_host.sim.simavr.board import SimavrBoard
from ccr_host.sim.simavr.flash_image import FLASH_BYTES, read_flash_image
from ccr_host.sim.simavr.mcu import built_shim
from ccr_host.sim.simavr.serve import optiboot


def test_elf_file_gives_segments_and_symbols(program):
    image = read_flash_image(program("masked"))
    assert image.start == 0
    assert 0 < image.symbols["main"] < FLASH_BYTES["uno"]
    assert 0x100 <= image.symbols["wakings"] < 0x900


@pytest.mark.parametrize(
    ("content", "cause"),
    [
        (b"", "no program"),
        (b":0200000000C03F\n", "line 1 is damaged"),
        (b"\x7fELF\x02\x01" + bytes(60), "another machine"),
        (b"\x7fELF\x01\x01" + bytes(10), "neither"),
        (b"\xff\xfe", "neither"),
        (b":02800000FFCFB0\n:00000001FF\n", "longer than 32768 bytes"),
    ],
    ids=["empty", "bad checksum", "64 bits", "cut off", "binary", "beyond the flash"],
)
def test_unusable_file_is_refused_with_its_cause(tmp_path, content, cause):
    path = tmp_path / "firmware.hex"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=cause):
        read_flash_image(path)


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        read_flash_image(tmp_path / "firmware.elf")


def test_boot_loader_lies_at_the_end_of_the_flash():
    image = optiboot()
    assert image.start in (0x7C00, 0x7E00)
    assert all(address + len(data) <= FLASH_BYTES["uno"] for address, data in image.segments)


def test_what_was_built_once_needs_no_compiler_any_more(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first, loader = built_shim(), optiboot()
    built_at = first.stat().st_mtime_ns
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    assert built_shim() == first
    assert first.stat().st_mtime_ns == built_at
    assert optiboot() == loader


def test_missing_compiler_is_reported_with_the_command_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(DeviceError, match=r"no C compiler .*libsimavr-dev"):
        built_shim()


def test_failed_build_of_the_shim_reports_the_compilers_reason(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiler = tmp_path / "cc"
    compiler.write_text("#!/bin/sh\necho 'rig.c:1: error: sim_avr.h: no such file' >&2\nexit 1\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    with pytest.raises(DeviceError, match=r"sim_avr\.h.*libsimavr-dev"):
        built_shim()
    assert not list((tmp_path / "ccr-host").glob("librig*"))


def test_two_boards_live_side_by_side(program):
    boards = [SimavrBoard(read_flash_image(program("echo"))) for _ in range(2)]
    for board in boards:
        board.advance_to(1000)
    for number, board in enumerate(boards):
        board.receive(bytes([number]))
        board.advance_to(2000)
    assert [board.take_output() for board in boards] == [b"\0", b"\1"]
