"""An emulated board in virtual time, and a client of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from ccr_host.core.clock import VirtualClock
from ccr_host.description.schema import load
from ccr_host.link.board_config import BoardConfig, board_config
from ccr_host.link.client import Client
from ccr_host.sim.board.board import UnoEmulator
from tests.faulty_line import FaultyLine

QUICK = ["link.arm_axis_ms=40", "link.relax_after_ms=400"]


@dataclass
class Rig:
    """Everything on one virtual clock."""

    clock: VirtualClock
    board: UnoEmulator
    line: FaultyLine

    def client(self, *, session: int = 0x1234, attach: bool = True, **observers: object) -> Client:
        client = Client(self.line, self.clock, session, **observers)
        if attach:
            self.clock.attach(client)
        return client

    def wait(self, duration_us: int) -> None:
        self.clock.sleep_until_us(self.clock.now_us() + duration_us)


class At:
    """Does something once, at a given time, on behalf of the clock."""

    def __init__(self, time_us: int, action: Callable[[], None]) -> None:
        self._time_us = time_us
        self._action: Callable[[], None] | None = action

    def advance_to(self, time_us: int) -> None:
        if self._action and time_us >= self._time_us:
            action, self._action = self._action, None
            action()


@pytest.fixture
def make_rig() -> Callable[..., Rig]:
    def make(**board_options: int) -> Rig:
        clock = VirtualClock()
        board = UnoEmulator(**board_options)
        line = FaultyLine(board)
        clock.attach(line)
        return Rig(clock, board, line)

    return make


@pytest.fixture
def rig(make_rig: Callable[..., Rig]) -> Rig:
    return make_rig()


@pytest.fixture
def config() -> BoardConfig:
    return board_config(load(None, QUICK))


@pytest.fixture
def at() -> type[At]:
    return At
