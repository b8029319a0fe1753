"""The simulated UNO on a pseudo-terminal, in real time: reset on opening, upload by avrdude."""

import subprocess
import time

import pytest
import serial

from ccr_host.core.errors import ConfigError
from ccr_host.sim.simavr.flash_image import find_firmware
from ccr_host.sim.simavr.serve import open_pty_server
from tests.patience import PATIENCE_S
from tests.served import wait_until_left

AVRDUDE = ["avrdude", "-q", "-D", "-p", "m328p", "-c", "arduino", "-b", "115200"]


def port_of(uri):
    return uri.removeprefix("serial:")


def ask(port, question, count):
    """Ask until there are `count` bytes of answer, however slow this machine is."""
    deadline = time.monotonic() + PATIENCE_S
    answer = b""
    while len(answer) < count and time.monotonic() < deadline:
        port.reset_input_buffer()
        port.write(question)
        answer = port.read(count)
    return answer


def avrdude(uri, hex_file):
    return subprocess.run(
        [*AVRDUDE, "-P", port_of(uri), "-U", f"flash:w:{hex_file}:i"],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


@pytest.fixture
def hex_file(program, tmp_path):
    def make(name):
        path = tmp_path / f"{name}.hex"
        subprocess.run(
            ["avr-objcopy", "-O", "ihex", "-R", ".eeprom", str(program(name)), str(path)],
            check=True,
        )
        return path

    return make


def test_opening_the_port_resets_the_board(program):
    with open_pty_server(program("resets"), boot_loader=False) as server:
        heard = []
        for _ in range(2):
            with serial.Serial(port_of(server.uri), 250000, timeout=0.5) as port:
                heard.append(ask(port, b"?", 2))
            wait_until_left(server)
    (first, second), external = heard, 2
    assert (first[0], second[0]) == (external, external)
    assert second[1] == first[1] + 1


def test_avrdude_flashes_an_empty_board_through_optiboot_and_the_program_runs(hex_file):
    with open_pty_server(None) as server:
        upload = avrdude(server.uri, hex_file("echo"))
        assert upload.returncode == 0, upload.stderr
        assert "verified" in upload.stderr
        with serial.Serial(port_of(server.uri), 250000, timeout=0.5) as port:
            assert ask(port, b"here I am", 9) == b"here I am"  # optiboot first waits for a second


def test_avrdude_finds_the_boot_loader_however_late_it_comes(program, hex_file):
    with open_pty_server(program("echo")) as server:
        with serial.Serial(port_of(server.uri), 250000, timeout=0.5) as held_open:
            assert ask(held_open, b"here I am", 9) == b"here I am"
            time.sleep(1.1)
            upload = avrdude(server.uri, hex_file("echo"))
        assert upload.returncode == 0, upload.stderr


def test_missing_firmware_is_reported_with_its_cure(tmp_path, monkeypatch):
    monkeypatch.setattr("ccr_host.sim.simavr.flash_image._CHECKOUT", tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="pio run"):
        find_firmware()
