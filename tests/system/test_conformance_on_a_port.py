"""The conformance suite on a board behind a port, as its user runs it: a part, in real time."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
import serial

from ccr_host.link import messages as m
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.device import EmulatedDevice
from tests.conformance.host import Host
from tests.patience import PATIENCE_S
from tests.system.conftest import CcrHost
from tests.system.test_emulate import served_uri

ROOT = Path(__file__).parents[2]
PART = [
    "test_boot_lasts_its_ticks",
    "test_axes_are_enabled_one_after_the_other",
    "test_ramp_is_a_straight_line_rounded_toward_zero",
    "test_silent_host_gets_hold_then_relaxing_then_link_loss",
    "test_saved_configuration_is_in_use_after_a_reset",
]
FOUND_SLEW = m.Slew((123, 321))


def conformance(uri: str, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--device", uri]
    return subprocess.run(
        [*command, *(words or ["tests/conformance/test_configuration.py"])],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=2 * PATIENCE_S,
        check=False,
    )


def configured_eeprom() -> bytes:
    host = Host(EmulatedDevice(EepromImage()))
    host.boot()
    host.open_session()
    host.configure(slew=FOUND_SLEW)
    host.save()
    return bytes(host.device.eeprom.content)


@pytest.fixture
def served(ccr_host: CcrHost):
    """Device URI of a served board with a configuration in its EEPROM."""
    (ccr_host.folder / "board.eeprom").write_bytes(configured_eeprom())
    server = ccr_host.start("emulate", "--pty", "--boot-ms", "100", "--eeprom", "board.eeprom")
    yield served_uri(server)
    server.send_signal(signal.SIGINT)
    server.communicate(timeout=PATIENCE_S)


def test_a_part_of_the_suite_passes_and_leaves_the_board_as_found(
    ccr_host: CcrHost, served: str
) -> None:
    ended = conformance(served, "tests/conformance", "-k", " or ".join(PART))
    assert ended.returncode == 0, ended.stdout
    assert f"{len(PART)} passed" in ended.stdout
    assert f"{served} will be armed and its servos moved" in ended.stdout
    assert f"{served} was left disarmed, the configuration found saved again" in ended.stdout
    image = EepromImage((ccr_host.folder / "board.eeprom").read_bytes())
    left = Host(EmulatedDevice(image))
    assert left.hello().eeprom_status is m.EepromStatus.LOADED
    assert left.config().slew == FOUND_SLEW


@pytest.mark.parametrize("trouble", ["there is no such port", "in use by another program"])
def test_a_port_that_cannot_be_used_gives_one_clear_line(
    served: str, trouble: str, tmp_path: Path
) -> None:
    port = served.removeprefix("serial:")
    if "in use" in trouble:
        with serial.Serial(port, exclusive=True):
            ended = conformance(served)
    else:
        ended = conformance(f"serial:{tmp_path / 'ttyUSB0'}")
    assert ended.returncode == 3
    (line,) = [line for line in ended.stdout.splitlines() if trouble in line]
    assert "(" in line, "with its cure"
    assert "Traceback" not in ended.stdout + ended.stderr
