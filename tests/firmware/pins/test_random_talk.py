"""The binary with arbitrary requests of a host, checked at the servo pins."""

from __future__ import annotations

from collections import deque
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from ccr_host.link import messages as m
from ccr_host.link.framing import Frame, FrameDecoder, encode_frame
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.device import AXES, PULSES_OVER_US, SimavrDevice
from tests.firmware.differential.script import Script
from tests.firmware.pins.mutants import AT_THE_PINS, IN_THE_HOST, INSIDE, Mutant
from tests.firmware.pins.oracle import PinOracle, ViolationError, require

FRAMES = 2500
"""50 s of the board's time."""
SEEDS = range(6)
MORE_SEEDS = range(400)
MORE_MEGA_SEEDS = range(40)
MUTANT_SEEDS = range(30)
_RESETS = list(m.ResetCause)
_SENT_WITHIN_US = {"uno": 4_000, "mega2560": 1_000}
"""Span of the moments at which bytes are sent: the longest of them end before the tick."""


class WatchedTalk:
    """Random requests to a binary, checked by the oracle frame by frame."""

    def __init__(
        self, seed: int, elf: Path | None = None, board: str = "uno", axes: int = AXES
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.axes, self._sent_within_us = axes, _SENT_WITHIN_US[board]
        self.device = SimavrDevice(EepromImage(), elf, board=board, axes=axes)
        self.script = Script(self.rng, axes=axes)
        self.pulses = 0
        self.states: set[m.State] = set()
        self._started()

    def _started(self) -> None:
        self.oracle = PinOracle(self.axes)
        self.state = m.State.BOOT
        self._heard, self._said = FrameDecoder(), FrameDecoder()
        self._unanswered: deque[Frame] = deque()
        self._frame = 0
        self._is_supplied = False

    def run(self, frames: int) -> None:
        for _ in range(frames):
            if self.rng.random() < 0.002:
                self._look()
                self.device.reset(_RESETS[int(self.rng.integers(len(_RESETS)))])
                self._started()
            self._one_frame()

    def _look(self) -> None:
        """Judge the frame before, in which all pulses have ended, and what was said in it."""
        self.device.advance_to(self._frame * m.TICK_US + PULSES_OVER_US)
        if self._frame > 0:
            before = self._frame - 1
            pins = self.device.seen_in_frame(before)
            self.oracle.look(before, pins)
            require(self._is_supplied == any(pins), "the supply is on with the pulses", before)
            self.pulses += sum(pulse > 0 for pulse in pins)
        self._read_answers()
        self._is_supplied = self.device.board.servo_supply_on

    def _one_frame(self) -> None:
        self._look()
        sent_us = 3_100 + int(self.rng.integers(0, self._sent_within_us))
        self.device.advance_to(self._frame * m.TICK_US + sent_us)
        self._say()
        self._frame += 1

    def _say(self) -> None:
        if self._frame == 0:
            return
        if self._frame == 1:
            ask = (m.GetLimits(), m.GetSlew(), m.GetWatchdog(), m.GetCalibration())
            data = b"".join(encode_frame(request.ID, 1, b"") for request in ask)
        else:
            hurried = self.rng.random() < 0.01
            data = self._hurry() if hurried else self.script.next_frame(self.state)
            # The zero ends what the script may have left unfinished.
            data += b"\0" + encode_frame(m.GetState.ID, 0, b"")
        self.device.send(data)
        self._unanswered += [f for f in self._said.feed(data) if isinstance(f, Frame)]

    def _hurry(self) -> bytes:
        """Stop, clear and arm again, far away, with no tick between."""
        session = self.script.session
        low = int(self.rng.integers(-9000, 8900))
        limits = m.Limits((low,) * self.axes, (low + 100,) * self.axes, (low,) * self.axes)
        return self.script.say(
            m.Stop(), m.SetLimits(session, limits), m.ClearFault(session), m.Arm(session)
        )

    def _read_answers(self) -> None:
        for answer in self._heard.feed(self.device.read()):
            assert isinstance(answer, Frame)
            message = m.MESSAGES[answer.id].unpack(answer.payload)
            if isinstance(message, m.Telemetry):
                continue
            require(bool(self._unanswered), "answered once", message)
            self._take_configuration(message)
            self.oracle.take(self._frame - 1, self._unanswered.popleft(), answer)
            if isinstance(message, m.StateReply):
                self.state = message.report.state
                self.states.add(self.state)
        require(not self._unanswered, "each request is answered", self._unanswered)

    def _take_configuration(self, message: m.Message) -> None:
        """What was loaded from EEPROM; later on it must be what was set."""
        oracle = self.oracle
        match message:
            case m.LimitsReply(group):
                require(oracle.limits in (None, group), "configuration as set", group)
                oracle.limits = group
            case m.SlewReply(group):
                require(oracle.slew in (None, group), "configuration as set", group)
                oracle.slew = group
            case m.WatchdogReply(group):
                require(oracle.watchdog in (None, group), "configuration as set", group)
                oracle.watchdog = group
            case m.CalibrationReply(group):
                require(oracle.calibration in (None, group), "configuration as set", group)
                oracle.calibration = group


def talk(
    seed: int,
    frames: int = FRAMES,
    elf: Path | None = None,
    board: str = "uno",
    axes: int = AXES,
) -> WatchedTalk:
    watched = WatchedTalk(seed, elf, board, axes)
    with closing(watched.device):
        watched.run(frames)
    return watched


def test_the_pins_obey_the_rules_whatever_a_host_sends() -> None:
    runs = [talk(seed) for seed in SEEDS]
    assert sum(run.pulses for run in runs) > 5000
    assert set.union(*(run.states for run in runs)) == set(m.State)


def test_the_pins_of_a_mega_obey_the_rules_whatever_a_host_sends() -> None:
    assert talk(12, 1000, board="mega2560", axes=12).pulses > 100


@pytest.mark.slow
@pytest.mark.parametrize("axes", [2, 6, 12])
@pytest.mark.parametrize("seed", MORE_MEGA_SEEDS)
def test_the_pins_of_a_mega_obey_the_rules_for_long_whatever_a_host_sends(
    seed: int, axes: int
) -> None:
    talk(2000 + seed, board="mega2560", axes=axes)


@pytest.mark.slow
@pytest.mark.parametrize("seed", MORE_SEEDS)
def test_the_pins_obey_the_rules_for_long_whatever_a_host_sends(seed: int) -> None:
    talk(1000 + seed)


def _broken_rule(elf: Path) -> str:
    """Rule broken by the first seed that breaks one; empty if none does."""
    for seed in MUTANT_SEEDS:
        try:
            talk(seed, elf=elf)
        except ViolationError as violation:
            return violation.rule
        except AssertionError as error:
            return str(error)
    return ""


@pytest.mark.slow
@pytest.mark.parametrize("mutant", AT_THE_PINS, ids=lambda mutant: mutant.name)
def test_the_oracle_detects_a_faulty_firmware_by_the_rule_that_it_breaks(
    mutant: Mutant, tmp_path: Path
) -> None:
    broken = _broken_rule(mutant.build(tmp_path))
    assert broken.startswith(tuple(mutant.noticed_by.split("|"))), broken or "none"


@pytest.mark.slow
@pytest.mark.parametrize("mutant", INSIDE, ids=lambda mutant: mutant.name)
def test_a_test_fails_on_a_faulty_firmware(mutant: Mutant, tmp_path: Path) -> None:
    assert mutant.is_noticed(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("mutant", IN_THE_HOST, ids=lambda mutant: mutant.name)
def test_a_test_fails_on_a_faulty_host(mutant: Mutant, tmp_path: Path) -> None:
    assert mutant.is_noticed(tmp_path)
