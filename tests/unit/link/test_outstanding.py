"""How many requests the client has outstanding, on boards with different limits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccr_host.core.clock import VirtualClock
from ccr_host.link import messages as m
from ccr_host.link.exchange import ANSWER_TIMEOUT_US, Exchange, LinkCounts
from ccr_host.link.framing import Frame, FrameDecoder, encode_frame
from ccr_host.link.messages import State
from tests.faulty_line import LineNoise

VALIDITY_MS = 300
TARGET = m.SetTarget(1, (0, 0), 0, VALIDITY_MS)


class Line:
    """What is under way on a link, as an observer of its frames sees it."""

    def __init__(self) -> None:
        self.under_way: dict[int, tuple[int, int]] = {}
        self.most_requests = self.most_bytes = 0
        self.ids: list[int] = []

    def __call__(self, way: str, time_us: int, data: bytes) -> None:
        (frame,) = FrameDecoder(m.MAX_PAYLOAD.of(m.MAX_AXES)).feed(data)
        assert isinstance(frame, Frame)
        if way == "received":
            if frame.id != m.Telemetry.ID:
                self.under_way.pop(frame.sequence, None)
            return
        self.ids.append(frame.id)
        recent_us = time_us - ANSWER_TIMEOUT_US
        self.under_way = {k: v for k, v in self.under_way.items() if v[1] > recent_us}
        self.under_way[frame.sequence] = len(data), time_us
        self.most_requests = max(self.most_requests, len(self.under_way))
        if len(self.under_way) > 1:
            total = sum(size for size, _ in self.under_way.values())
            self.most_bytes = max(self.most_bytes, total)


def run_in_bursts(rig: Any, config: Any, line: Line) -> Any:
    with rig.client(on_frame=line) as client:
        client.connect()
        client.configure(config)
        client.arm()
        for step in range(300):
            for _ in range(7):
                client.set_target((0.3 * np.sin(step), 0.0), ramp_ms=0, validity_ms=VALIDITY_MS)
            rig.wait(40_000)
    return client.statistics


@pytest.mark.parametrize(
    ("limits", "requests", "most_bytes"),
    [
        (m.LinkLimitsReply(1, 63), 1, 0),
        (m.LinkLimitsReply(5, 1), 1, 0),
        (m.LinkLimitsReply(2, 63), 2, 63),
        (m.LinkLimitsReply(200, 1000), 8, 1000),
        (None, m.OUTSTANDING_REQUESTS, m.OUTSTANDING_BYTES.of(2)),
    ],
)
def test_a_run_keeps_to_what_the_board_announces(
    make_rig: Callable[..., Any], config: Any, limits: Any, requests: int, most_bytes: int
) -> None:
    line = Line()
    statistics = run_in_bursts(make_rig(link_limits=limits), config, line)
    assert line.most_requests <= requests
    assert line.most_bytes <= most_bytes
    assert m.ClockSync.ID in line.ids
    assert statistics.retries == statistics.unanswered_targets == 0
    asked = line.ids.count(m.GetLinkLimits.ID)
    assert asked == (limits is not None), "an optional request goes only to a board that knows it"


def test_before_hello_only_one_request_is_outstanding() -> None:
    exchange = Exchange(Deaf(), VirtualClock(), LinkCounts(), lambda _: None, None)
    assert exchange.limits.outstanding_requests == 1


def test_a_lost_answer_holds_the_next_request_back_for_the_timeout_only(
    make_rig: Callable[..., Any], config: Any
) -> None:
    rig = make_rig(link_limits=m.LinkLimitsReply(1, 63))
    with rig.client() as client:
        client.connect()
        client.configure(config)
        client.arm()
        rig.line.noise = LineNoise(np.random.default_rng(1), drop=1.0)
        client.set_target((0.0, 0.0), ramp_ms=0, validity_ms=10_000)
        rig.line.noise = None
        before_us = rig.clock.now_us()
        client.set_target((0.1, 0.0), ramp_ms=0, validity_ms=10_000)
        assert ANSWER_TIMEOUT_US <= rig.clock.now_us() - before_us < 1.1 * ANSWER_TIMEOUT_US
        rig.wait(50_000)
        assert client.accepted_rad == pytest.approx([0.1, 0.0], abs=1e-3)


def test_stop_is_never_held_back(make_rig: Callable[..., Any], config: Any) -> None:
    rig = make_rig(link_limits=m.LinkLimitsReply(1, 63))
    with rig.client() as client:
        client.connect()
        client.configure(config)
        client.arm()
        before_us = rig.clock.now_us()
        client.set_target((0.0, 0.0), ramp_ms=0, validity_ms=10_000)
        sent_us: list[int] = []
        client._exchange._on_frame = lambda way, now_us, _: sent_us.append(now_us)
        client.stop()
        assert sent_us[0] == before_us
        assert rig.board.state is State.STOPPED


class Deaf:
    """A transport whose other end is silent until told what to say."""

    name = "deaf:"

    def __init__(self) -> None:
        self.to_say = b""
        self.heard: list[Frame] = []

    def write(self, data: bytes) -> None:
        self.heard += [one for one in FrameDecoder().feed(data) if isinstance(one, Frame)]

    def read(self) -> bytes:
        said, self.to_say = self.to_say, b""
        return said

    def close(self) -> None:
        pass


@settings(max_examples=50, deadline=None)
@given(
    limit=st.integers(1, 8),
    limit_bytes=st.integers(0, 200),
    answered=st.lists(st.booleans(), min_size=1, max_size=60),
)
def test_whatever_is_answered_the_limits_are_kept(
    limit: int, limit_bytes: int, answered: list[bool]
) -> None:
    line, clock, deaf = Line(), VirtualClock(), Deaf()
    exchange = Exchange(deaf, clock, LinkCounts(), lambda _: None, line)
    exchange.limits = m.LinkLimitsReply(limit, limit_bytes)
    for has_answer in answered:
        sequence, _ = exchange.send(TARGET)
        assert deaf.heard[-1].sequence == sequence
        if has_answer:
            reply = m.TargetReply(State.ACTIVE, m.StatusFlags(0), (0, 0))
            deaf.to_say += encode_frame(reply.ID, sequence, reply.pack())
        report = encode_frame(m.Telemetry.ID, sequence, b"")
        deaf.to_say += report
        exchange.poll(clock.now_us())
    assert line.most_requests <= limit
    assert line.most_bytes <= limit_bytes
