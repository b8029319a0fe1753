"""Targets that take effect at a stated tick, an optional request."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ccr_host.link import messages as m
from ccr_host.link.client import Client
from ccr_host.link.device_errors import MissingCapabilityError, RequestRefusedError
from ccr_host.link.messages import State
from ccr_host.sim.board import dispatch

VALIDITY_MS = 300


def armed(rig: Any, config: Any) -> Client:
    client: Client = rig.client()
    client.connect()
    client.configure(config)
    client.arm()
    return client


def test_a_timed_target_moves_the_robot_at_its_tick_and_feeds_the_watchdog(
    rig: Any, config: Any
) -> None:
    with armed(rig, config) as client:
        tick = client.read_state().tick + 12
        client.set_target_at(tick, (0.2, -0.1), ramp_ms=0, validity_ms=VALIDITY_MS)
        rig.wait(8 * m.TICK_US)
        assert client.read_state().state is State.HOLD
        rig.wait(8 * m.TICK_US)
        client.poll()
        report = client.read_state()
        assert report.state is State.ACTIVE
        assert report.target_age_ms == (report.tick - tick + 1) * m.TICK_US // 1000
        assert np.radians(report.target_cdeg) / 100 == pytest.approx([0.2, -0.1], abs=1e-3)
        with pytest.raises(RequestRefusedError):
            client.set_target_at(tick, (0.2, -0.1), ramp_ms=0, validity_ms=VALIDITY_MS)


def test_a_timed_target_out_of_range_is_refused_before_it_is_sent(rig: Any, config: Any) -> None:
    with armed(rig, config) as client, pytest.raises(ValueError, match="validity of 10 ms"):
        client.set_target_at(10**6, (0.0, 0.0), ramp_ms=0, validity_ms=10)


def test_a_board_of_older_firmware_is_driven_and_told_what_it_lacks(
    rig: Any, config: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatch, "CAPABILITIES", m.Capabilities.EEPROM)
    rig.board.reset(m.ResetCause.EXTERNAL)
    with armed(rig, config) as client:
        client.set_target((0.1, 0.1), ramp_ms=0, validity_ms=VALIDITY_MS)
        rig.wait(50_000)
        assert rig.board.state is State.ACTIVE
        before = client.read_counters().nacks
        with pytest.raises(MissingCapabilityError, match="does not know set_target_at") as missing:
            client.set_target_at(10**6, (0.0, 0.0), ramp_ms=0, validity_ms=VALIDITY_MS)
        assert "ccr-host flash" in missing.value.cure
        assert client.read_counters().nacks == before, (
            "nothing that the board does not know was sent"
        )
