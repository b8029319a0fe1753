"""Commands, replies and check sums as pure functions."""

import pytest
from crccheck.crc import Crc16Arc
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.core.errors import TrackerError
from ccr_host.core.wire import crc16_arc
from ccr_host.tracking.sources.ndi.device_errors import meaning_of
from ccr_host.tracking.sources.ndi.replies import (
    LONGEST_REPLY_BYTES,
    CommandRefusedError,
    DamagedReplyError,
    ReplySplitter,
    SystemStatus,
    decode_reply,
    encode_command,
    system_warnings,
)

PRINTABLE = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1)


@pytest.mark.parametrize(
    ("text", "crc"),
    [
        (b"INIT:", 0xE3A5),
        (b"OKAY", 0xA896),
        (b"RESET", 0xBE6F),
        (b"TSTART:", 0x5423),
        (b"PHSR:00", 0x20FF),
        (b"123456789", 0xBB3D),
    ],
)
def test_crc_of_known_messages(text, crc):
    assert crc16_arc(text) == crc


@given(st.binary(max_size=300))
def test_crc_agrees_with_an_independent_one(data):
    assert crc16_arc(data) == Crc16Arc.calc(data)


def test_command_carries_colon_crc_and_carriage_return():
    assert encode_command("INIT") == b"INIT:E3A5\r"
    assert encode_command("PHSR", "00") == b"PHSR:0020FF\r"


@given(PRINTABLE)
def test_reply_gives_back_what_was_sent(text):
    data = text.encode()
    line = b"%s%04X" % (data, crc16_arc(data))
    if text.startswith("ERROR") and len(text) == 7:
        return
    assert decode_reply(line) == text


def test_refusal_carries_its_code_and_says_what_to_do():
    data = b"ERROR0C"
    with pytest.raises(CommandRefusedError, match=r"ERROR0C.*mode") as refusal:
        decode_reply(b"%s%04X" % (data, crc16_arc(data)))
    assert refusal.value.code == 0x0C
    assert refusal.value.cure


@pytest.mark.parametrize("line", [b"", b"A896", b"OKAY", b"OKAYA897", b"OKAYa896", b"OKAX\xa896"])
def test_damaged_reply_is_refused(line):
    with pytest.raises(DamagedReplyError):
        decode_reply(line)


@given(st.binary(max_size=200))
def test_any_bytes_are_text_or_a_typed_error(data):
    try:
        assert isinstance(decode_reply(data), str)
    except TrackerError as error:
        assert error.cause
        assert error.cure


@given(st.lists(st.binary(max_size=20)), st.lists(st.integers(0, 30), max_size=20))
def test_splitter_does_not_care_how_the_stream_is_cut(lines, cuts):
    stream = b"".join(line.replace(b"\r", b"") + b"\r" for line in lines)
    splitter, found, at = ReplySplitter(), [], 0
    for cut in [*cuts, len(stream)]:
        found += splitter.feed(stream[at : at + cut])
        at += cut
    assert found == stream.split(b"\r")[:-1]


def test_splitter_forgets_an_endless_line():
    splitter = ReplySplitter()
    for _ in range(10):
        splitter.feed(b"x" * LONGEST_REPLY_BYTES)
    splitter.feed(b"x" * (LONGEST_REPLY_BYTES + 1))
    assert splitter.feed(b"OKAY\r") == [b"OKAY"]


def test_status_bits_become_readable_lines():
    assert system_warnings(SystemStatus(0)) == ()
    hot = system_warnings(SystemStatus.TEMPERATURE | SystemStatus.DIAGNOSTIC_PENDING)
    assert len(hot) == 2
    assert any("temperature" in line for line in hot)
    assert any("diagnostic" in line for line in hot)


@pytest.mark.parametrize(
    ("code", "told"),
    [
        (0x06, "communication parameters"),
        (0x09, "priority"),
        (0x2A, "memory"),
        (0x34, "user parameter"),
        (0x02, "too long"),
        (0x40, "tool definition"),
        (0xF6, "flash"),
        (0x77, "not documented"),
    ],
)
def test_refusals_are_explained_with_cause_and_cure(code, told):
    cause, cure = meaning_of(code)
    assert f"ERROR{code:02X}" in cause
    assert told in cause
    assert cure


def test_every_documented_error_code_has_a_meaning():
    documented = {*range(0x01, 0x26), *range(0x28, 0x31), *range(0x32, 0x3A)} | {
        *range(0x3B, 0x3E), *range(0x40, 0x43), 0xF1, 0xF4, 0xF5, 0xF6
    }  # fmt: skip
    assert [f"{code:02X}" for code in documented if "not documented" in meaning_of(code)[0]] == []
