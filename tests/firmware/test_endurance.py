"""The firmware's binary over hours of its time, with a host that is active and silent in turn."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

from ccr_host.core.clock import VirtualClock
from ccr_host.description import schema
from ccr_host.link import messages as m
from ccr_host.link.board import drawn_session
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client
from ccr_host.link.device_errors import LinkLossError
from ccr_host.sim.simavr.board import SimavrBoard, SimavrLine
from ccr_host.sim.simavr.flash_image import read_flash_image
from tests.conformance.firmware_build import firmware_elf

HOUR_S = 3600
WRAP_S = 2**32 / 1e6


def operate(
    seed: int, duration_s: float, board_time_at_reset_us: int = 0, name: str = "uno", axes: int = 2
) -> None:
    """Targets every second, and occasional silence that ends in link loss and a new start."""
    rng = np.random.default_rng(seed)
    start = f"-DCCR_TIME_AT_RESET_US={board_time_at_reset_us}UL"
    elf = firmware_elf(start, "-UCCR_AXES", f"-DCCR_AXES={axes}", board=name)
    with closing(SimavrBoard(read_flash_image(elf))) as board:
        line, clock = SimavrLine(board), VirtualClock(slice_us=m.TICK_US)
        clock.attach(line)
        resets_at_start = board.mcu.statistics().resets
        with Client(line, clock, drawn_session(rng)) as client:
            clock.attach(client)
            client.connect(telemetry_period_ticks=5)
            client.configure(board_config(schema.load()).for_board(axes))
            boot_id = client.identity.boot_id
            client.arm()
            last_tick = 0
            while clock.now_us() < duration_s * 1e6:
                client.set_target(rng.uniform(-1.4, 1.4, axes), ramp_ms=0, validity_ms=2500)
                clock.sleep_until_us(clock.now_us() + 1_000_000)
                if rng.random() < 0.002:
                    lose_the_link(client, clock)
                tick = client.telemetry.report.tick
                assert tick > last_tick
                last_tick = tick
            elapsed_us = board.now_us
            board_us = client._ask(m.ClockSync(0), m.ClockReply).board_time_us
            expected_us = (board_time_at_reset_us + elapsed_us) % 2**32
            assert board_us == pytest.approx(expected_us, abs=5_000)
            assert client.read_state().fault is m.Fault.NONE
            assert client.identity.boot_id == boot_id
        assert board.mcu.statistics().resets == resets_at_start
        assert client.statistics.crc_errors == client.statistics.retries == 0


def lose_the_link(client: Client, clock: VirtualClock) -> None:
    with pytest.raises(LinkLossError):
        clock.sleep_until_us(clock.now_us() + 30_000_000)
        client.poll()
    client.clear_fault()
    client.arm()


@pytest.mark.parametrize(("board", "axes"), [("uno", 2), ("mega2560", 12)])
def test_minutes_of_operation_across_the_wrap_of_the_microsecond_clock(
    board: str, axes: int
) -> None:
    operate(1, 150, board_time_at_reset_us=2**32 - 60_000_000, name=board, axes=axes)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(36))
def test_two_hours_of_operation(seed: int) -> None:
    """72 hours in all; each run crosses the wrap after 71.6 minutes."""
    assert 2 * HOUR_S > WRAP_S
    operate(seed, 2 * HOUR_S)


@pytest.mark.slow
@pytest.mark.parametrize("axes", [2, 6, 12])
@pytest.mark.parametrize("seed", range(4))
def test_two_hours_of_operation_of_a_mega(seed: int, axes: int) -> None:
    operate(seed, 2 * HOUR_S, name="mega2560", axes=axes)
