"""The parser of TX replies: what was sent comes out, anything else is refused."""

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccr_host.core.errors import TrackerError
from ccr_host.core.wire import crc16_arc
from ccr_host.tracking.sources.ndi.replies import (
    DamagedReplyError,
    SystemStatus,
    TxReply,
    decode_reply,
    parse_tx,
)
from tests.unit.tracking.sources.ndi.random_replies import Contents, random_contents

ROUND_TRIPS = 10_000
DAMAGED = 20_000

EXAMPLE = (
    "03"
    "01+10000+00000+00000+00000+001234-005678-090000+00915" + "00000031" + "0000012C\n"
    "02MISSING" + "00000031" + "0000012C\n"
    "03DISABLED" + "00000011" + "00000000\n"
    "02" + "4" + "+001000-002000-100000" + "-000001+000000-140000" + "0300"
)


def same(a: TxReply, b: TxReply) -> bool:
    return parts(a) == parts(b)


def parts(reply: TxReply) -> tuple:
    tools = tuple(
        (t.handle, t.frame)
        + (() if t.pose is None else (tuple(t.pose.position_mm), tuple(t.pose.quaternion)))
        for t in reply.tools
    )
    return tools, reply.strays_mm.tobytes(), reply.system_status


def test_example_by_hand():
    reply = parse_tx(EXAMPLE)
    first, second, third = reply.tools
    np.testing.assert_array_equal(first.pose.position_mm, (12.34, -56.78, -900))
    np.testing.assert_array_equal(first.pose.quaternion, (1, 0, 0, 0))
    assert first.pose.error_mm == 0.0915
    assert (second.pose, second.frame) == (None, 300)
    assert (third.pose, third.frame) == (None, 0)
    assert reply.frame == 300
    np.testing.assert_array_equal(reply.strays_mm, [(10, -20, -1000), (-0.01, 0, -1400)])
    assert reply.system_status == SystemStatus.TEMPERATURE | SystemStatus.DIAGNOSTIC_PENDING


def test_reply_without_tools_and_strays():
    reply = parse_tx("00" + "00" + "0000")
    assert reply.tools == ()
    assert reply.frame is None
    assert reply.strays_mm.shape == (0, 3)


def test_unoccupied_handle_has_no_frame():
    (tool,) = parse_tx("01" + "0AUNOCCUPIED\n" + "00" + "0000").tools
    assert (tool.handle, tool.pose, tool.frame) == (10, None, None)


@pytest.mark.long
def test_10000_random_frames_round_trip_exactly():
    rng = np.random.default_rng(1)
    for _ in range(ROUND_TRIPS):
        sent = random_contents(rng)
        check(sent, parse_tx(decode_reply(with_crc(sent.text()))))


def check(sent: Contents, got: TxReply) -> None:
    assert np.array_equal(got.strays_mm, sent.strays.positions_mm)
    assert got.system_status == sent.status
    assert len(got.tools) == len(sent.tools)
    for tool, line in zip(got.tools, sent.tools, strict=True):
        assert (tool.handle, tool.frame) == (line.handle, line.frame)
        assert (tool.pose is None) == (line.position_mm is None)
        if tool.pose is not None:
            assert np.array_equal(tool.pose.position_mm, line.position_mm)
            assert np.array_equal(tool.pose.quaternion, line.quaternion)


def with_crc(text: str) -> bytes:
    return b"%s%04X" % (text.encode(), crc16_arc(text.encode()))


def damage(line: bytes, rng: np.random.Generator) -> bytes:
    """One of: bits flipped, bytes replaced, lost, doubled, cut off, or two lines run together."""
    data = bytearray(line)
    at = int(rng.integers(len(data)))
    match rng.integers(6):
        case 0:
            data[at] ^= 1 << int(rng.integers(8))
        case 1:
            for _ in range(rng.integers(1, 6)):
                data[int(rng.integers(len(data)))] = rng.integers(256)
        case 2:
            del data[at : at + int(rng.integers(1, 30))]
        case 3:
            data[at:at] = data[at : at + int(rng.integers(1, 30))]
        case 4:
            del data[at:]
        case 5:
            data[at:] = line[int(rng.integers(len(line))) :]
    return bytes(data)


@pytest.mark.long
def test_damaged_frames_never_give_a_wrong_marker():
    rng = np.random.default_rng(2)
    refused = 0
    for _ in range(DAMAGED // 20):
        contents = random_contents(rng)
        line = with_crc(contents.text())
        original = parse_tx(contents.text())
        for _ in range(20):
            try:
                got = parse_tx(decode_reply(damage(line, rng)))
            except TrackerError:
                refused += 1
            else:
                assert same(got, original)
    assert refused > 0.9 * DAMAGED


def test_burst_of_up_to_16_bits_is_always_found():
    rng = np.random.default_rng(3)
    line = with_crc(EXAMPLE)
    for at in range(8 * len(line) - 16):
        bits = (int(rng.integers(1, 2**16)) | 1) << at
        spoilt = (int.from_bytes(line, "little") ^ bits).to_bytes(len(line), "little")
        with pytest.raises(TrackerError):
            parse_tx(decode_reply(spoilt))


def test_grammar_alone_refuses_most_damage_that_a_check_sum_would_miss():
    rng = np.random.default_rng(4)
    accepted = 0
    for _ in range(2000):
        text = damage(EXAMPLE.encode(), rng).decode("latin-1")
        try:
            parse_tx(text)
            accepted += text != EXAMPLE
        except DamagedReplyError:
            pass
    assert accepted < 500  # a digit that became another digit


@settings(max_examples=500)
@given(st.text(st.sampled_from("0123456789ABCDEF+-MISNGDABLEUOCP\n_ ")))
def test_any_text_is_a_reply_or_a_typed_error(text):
    with contextlib.suppress(DamagedReplyError):
        assert np.isfinite(parse_tx(text).strays_mm).all()


@pytest.mark.parametrize(
    "text",
    [
        EXAMPLE + "0",
        EXAMPLE[:-1],
        EXAMPLE.replace("\n", "", 1),
        EXAMPLE.replace("+001000", "+0_1000"),
        EXAMPLE.replace("+001000", "+0 1000"),
        EXAMPLE.replace("+10000", "+20000"),
        EXAMPLE.replace("0300", "03g0"),
        "00" + "33" + "0" * 13 + "+000000" * 153 + "0000",
        "०१" + "00" + "0000",
    ],
)
def test_almost_right_replies_are_refused(text):
    with pytest.raises(DamagedReplyError):
        parse_tx(text)
