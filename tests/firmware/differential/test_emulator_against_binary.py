"""Emulator and firmware, written apart from one spec, say and do the same.

The same bytes go to both at the same times; whatever they answer is compared byte for byte, and the
pulses on their pins to 0.5 us in every frame. Allowed to differ: the free stack, which an emulator
does not have, and by a few milliseconds the time that clock_sync reads. Not tried: requests whose
last byte arrives so near a control tick that they may be dispatched on either side of it, and long
talk in the first frame after a reset, of which a real board loses some while it counts the boot.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ccr_host.link import messages as m
from ccr_host.link.framing import Frame, FrameDecoder
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.device import (
    AXES,
    PULSES_OVER_US,
    Device,
    EmulatedDevice,
    Pulses,
    SimavrDevice,
)
from tests.firmware.differential.script import Script

COMMANDS_PER_SEED = 10_000
MEGA_COMMANDS = 3_000
SEEDS = range(4)
MORE_SEEDS = range(4, 110)
MORE_MEGA_SEEDS = range(110, 130)

_SEND_AT_US = 3_500
"""Into the frame, after its pulses and 5.5 ms after the tick."""
_CLOCK_TOLERANCE_US = 3_000
_MOST_LATE_WORDS = 3
"""Long answers and a report may take a large board beyond the moment of comparison."""
_RESETS = [
    m.ResetCause.POWER_ON,
    m.ResetCause.EXTERNAL,
    m.ResetCause.BROWN_OUT,
    m.ResetCause.WATCHDOG,
]


class Listener:
    """Output of a device in a comparable form."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.heard: list[tuple[int, m.Message]] = []
        """What it has said, with sequence numbers, and what was not yet compared."""
        self._decoder = FrameDecoder()

    def listen(self) -> None:
        frames = self._decoder.feed(self.device.read())
        assert all(isinstance(frame, Frame) for frame in frames), "a board sends only frames"
        self.heard += [(f.sequence, m.MESSAGES[f.id].unpack(f.payload)) for f in frames]

    def reset(self, cause: m.ResetCause) -> None:
        """What it was about to say is lost."""
        self.device.reset(cause)
        self.heard.clear()


def _said_by_both(
    both: Sequence[Listener],
) -> tuple[list[list[tuple[int, m.Message]]], list[NDArray[np.int64]]]:
    """Comparable words, and clock readings; one may have yet to say what the other has said."""
    for one in both:
        one.listen()
    count = min(len(one.heard) for one in both)
    assert max(len(one.heard) for one in both) <= count + _MOST_LATE_WORDS
    said = [one.heard[:count] for one in both]
    for one in both:
        del one.heard[:count]
    words = [[(n, _without_what_may_differ(message)) for n, message in one] for one in said]
    clocks = [[w.board_time_us for _, w in one if isinstance(w, m.ClockReply)] for one in said]
    return words, [np.array(readings) for readings in clocks]


def _without_what_may_differ(message: m.Message) -> m.Message:
    match message:
        case m.Telemetry(report) | m.StateReply(report):
            return type(message)(replace(report, free_stack_bytes=0))
        case m.HelloReply():
            compared = message.capabilities & ~m.Capabilities.STACK_MONITOR
            return replace(message, capabilities=compared)
        case m.ClockReply():
            return replace(message, board_time_us=0)
    return message


def test_the_script_draws_every_request_of_the_spec() -> None:
    script = Script(np.random.default_rng(1), accelerations=True, tick=5)
    drawn = {type(script._request(state)) for state in m.State for _ in range(500)}
    assert drawn == set(m.REQUESTS.values())


def run_both(
    seed: int,
    commands: int,
    board: str = "uno",
    axes: int = AXES,
    wanted: frozenset[m.State] = frozenset(),
) -> tuple[int, set[m.State]]:
    """Commands sent and states seen; raises where the two differ.

    The talk goes on until the wanted states have been seen, up to ten times as long.
    """
    rng = np.random.default_rng(seed)
    script = Script(rng, accelerations=True, axes=axes)
    states: set[m.State] = set()
    with (
        closing(EmulatedDevice(EepromImage(), axes=axes)) as emulated,
        closing(SimavrDevice(EepromImage(), board=board, axes=axes)) as real,
    ):
        both = [Listener(emulated), Listener(real)]
        frame = 0
        pulses_before: Pulses = (0,) * axes
        while script.commands < commands or (
            not wanted <= states and script.commands < 10 * commands
        ):
            pulses = emulated.pulses_in_frame(frame)
            real.advance_to(frame * m.TICK_US + PULSES_OVER_US)
            words, clocks_us = _said_by_both(both)
            context = f"seed {seed}, frame {frame}, last: {script.history[-6:]}"
            # Of the frame before, as a Mega's last pulses come late in a frame.
            assert real.seen_in_frame(frame - 1) == pulses_before, context
            pulses_before = pulses
            assert words[0] == words[1], context
            assert emulated.board.led_on == real.board.led_on, context
            assert emulated.board.servo_supply_on == real.board.servo_supply_on, context
            apart_us = abs(clocks_us[0] - clocks_us[1])
            assert (apart_us <= _CLOCK_TOLERANCE_US).all(), context
            states.add(emulated.board.state)
            if rng.random() < 0.0005:
                cause = _RESETS[int(rng.integers(len(_RESETS)))]
                script.history.append(f"reset by {cause.name}")
                for one in both:
                    one.reset(cause)
                frame = 0
                pulses_before = (0,) * axes
                continue
            if rng.random() < 0.02:
                is_open = rng.random() < 0.2
                script.history.append(f"emergency stop {'opened' if is_open else 'closed'}")
                emulated.board.open_emergency_stop(is_open)
                real.board.open_emergency_stop(is_open)
                voltage_mv = int(2 * rng.integers(256) + 1) * 5000 // 512  # where ADCs agree
                emulated.board.set_supply_pin_mv(voltage_mv)
                real.board.set_supply_pin_mv(voltage_mv)
            script.tick = frame + 1
            data = script.next_frame(emulated.board.state) if frame > 0 else b""
            for one in both:
                one.device.advance_to(frame * m.TICK_US + _SEND_AT_US)
                one.device.send(data)
            frame += 1
        assert emulated.eeprom.content == real.eeprom.content
    return script.commands, states


@pytest.mark.parametrize("seed", SEEDS)
def test_emulator_and_firmware_answer_and_move_alike(seed: int) -> None:
    commands, states = run_both(seed, COMMANDS_PER_SEED)
    assert commands >= COMMANDS_PER_SEED
    assert states == set(m.State), "the talk led through every state"


@pytest.mark.parametrize(("axes", "seed"), [(1, 1), (6, 6), (12, 12)])
def test_a_mega_of_any_number_of_axes_does_what_the_emulator_does(axes: int, seed: int) -> None:
    wanted = frozenset({m.State.ARMING, m.State.ACTIVE, m.State.HOLD})
    commands, states = run_both(seed, MEGA_COMMANDS, "mega2560", axes, wanted)
    assert commands >= MEGA_COMMANDS
    assert states >= wanted


@pytest.mark.slow
@pytest.mark.parametrize("axes", [2, 6, 12])
@pytest.mark.parametrize("seed", MORE_MEGA_SEEDS)
def test_a_mega_does_what_the_emulator_does_for_long(axes: int, seed: int) -> None:
    run_both(seed, COMMANDS_PER_SEED, "mega2560", axes)


@pytest.mark.slow
@pytest.mark.parametrize("seed", MORE_SEEDS)
def test_emulator_and_firmware_answer_and_move_alike_for_long(seed: int) -> None:
    run_both(seed, COMMANDS_PER_SEED)
