"""`ccr-host flash`: port detection, upload, hello."""

import os
import pty
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest

from ccr_host.core.errors import ConfigError, DeviceError
from ccr_host.link import messages as m
from ccr_host.sim.simavr.serve import open_pty_server
from ccr_host.tools.flash import choose_port, flash_board, say_hello, upload_file, upload_project
from tests.conformance.firmware_build import firmware_elf
from tests.served import wait_until_left

CHECKOUT = Path(__file__).parents[3]


@dataclass
class Port:
    device: str
    vid: int | None = None
    pid: int | None = None


@pytest.fixture
def device(tmp_path):
    """Path of a serial port that can be opened."""
    with ExitStack() as stack:

        def make(name):
            master, slave = pty.openpty()
            stack.callback(os.close, master)
            stack.callback(os.close, slave)
            (tmp_path / name).symlink_to(os.ttyname(slave))
            return str(tmp_path / name)

        yield make


def test_uno_is_found_among_other_ports(device):
    uno = Port(device("ttyACM0"), 0x2341, 0x0043)
    other = Port(device("ttyUSB0"), 0x1A86, 0x7523)
    assert choose_port(None, [Port(device("ttyS0")), other, uno]) == uno.device


def test_compatible_board_is_found_if_there_is_no_genuine_one(device):
    clone = Port(device("ttyUSB0"), 0x1A86, 0x7523)
    assert choose_port(None, [Port(device("ttyS0")), clone]) == clone.device


def test_with_several_boards_one_has_to_be_named(device):
    boards = [Port(device(f"ttyACM{i}"), 0x2341, 0x0043) for i in range(2)]
    with pytest.raises(ConfigError, match=r"ttyACM0, .*ttyACM1.*--port"):
        choose_port(None, boards)
    assert choose_port(boards[1].device, boards) == boards[1].device


def test_no_board(device):
    with pytest.raises(DeviceError, match=r"no UNO found.*--port"):
        choose_port(None, [Port(device("ttyS0"))])


def test_port_that_is_not_there(tmp_path):
    with pytest.raises(DeviceError, match="no such port"):
        choose_port(str(tmp_path / "ttyACM9"))


def test_an_invalid_port_is_rejected_before_the_build(tmp_path):
    with pytest.raises(DeviceError, match="not a serial port"):
        choose_port(str(tmp_path))


@pytest.fixture
def image(tmp_path):
    """A program that hangs."""
    path = tmp_path / "a.hex"
    path.write_text(":0200000000C03E\n:00000001FF\n")
    return path


def test_missing_programs_are_reported_with_the_command_that_installs_them(
    device, image, monkeypatch, tmp_path
):
    monkeypatch.setenv("PATH", str(tmp_path))
    port = device("ttyACM0")
    with pytest.raises(ConfigError, match="pip install platformio"):
        upload_project(port, CHECKOUT)
    monkeypatch.setenv("PLATFORMIO_CORE_DIR", str(tmp_path))
    with pytest.raises(ConfigError, match="apt install avrdude"):
        upload_file(port, image)


def test_platformios_avrdude_is_used_if_the_system_has_none(
    device, image, monkeypatch, tmp_path, capfd
):
    program = tmp_path / "packages/tool-avrdude/bin/avrdude"
    program.parent.mkdir(parents=True)
    program.write_text('#!/bin/sh\necho "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("PLATFORMIO_CORE_DIR", str(tmp_path))
    upload_file(device("ttyACM0"), image)
    assert f"-C {tmp_path}/packages/tool-avrdude/avrdude.conf" in capfd.readouterr().err


def test_file_that_is_not_firmware_is_rejected_before_the_board_is_touched(device, tmp_path):
    image = tmp_path / "a.hex"
    image.write_text("nonsense")
    with pytest.raises(ConfigError, match="neither an ELF file for AVR nor Intel HEX"):
        upload_file(device("ttyACM0"), image)


def test_a_mega_is_found_by_its_own_ids_and_flashed_with_its_own_boot_loader(
    device, image, monkeypatch, tmp_path, capfd
):
    mega = Port(device("ttyACM1"), vid=0x2341, pid=0x0042)
    boards = [Port(device("ttyACM0"), vid=0x2341, pid=0x0043), mega]
    assert choose_port(None, boards, "mega2560") == mega.device
    avrdude = tmp_path / "bin/avrdude"
    avrdude.parent.mkdir()
    avrdude.write_text('#!/bin/sh\necho "$@"\n')
    avrdude.chmod(0o755)
    monkeypatch.setenv("PATH", str(avrdude.parent), prepend=os.pathsep)
    elf = firmware_elf(board="mega2560")
    upload_file(mega.device, elf, "mega2560")
    assert "-p m2560 -c wiring" in capfd.readouterr().err
    with pytest.raises(ConfigError, match=r"built for the Mega 2560 .give --board mega2560"):
        upload_file(mega.device, elf)


def test_failed_upload_is_a_device_error(device, tmp_path):
    with pytest.raises(DeviceError, match="failed, see above"):
        upload_project(device("ttyACM0"), CHECKOUT, pio="false")


@pytest.fixture(scope="module")
def built(tmp_path_factory, core_folder):
    """Environment in which pio of the project runs without the registry and outside the tree."""
    patch = pytest.MonkeyPatch()
    patch.setenv("PYTHON", sys.executable)
    patch.setenv("CCR_PLATFORMIO_CORE", str(core_folder))
    patch.setenv("PLATFORMIO_BUILD_DIR", str(tmp_path_factory.mktemp("build")))
    yield str(CHECKOUT / "scripts/platformio-offline/pio")
    patch.undo()


def test_projects_firmware_is_built_flashed_and_says_hello(built):
    with open_pty_server(None) as server:
        port = server.uri.removeprefix("serial:")
        _, identity = flash_board(port, project=CHECKOUT, pio=built)
        assert identity.spec_hash == m.SPEC_HASH
        wait_until_left(server)
        assert say_hello(port).boot_id == identity.boot_id + 1
