"""CRC, frames, and the golden vectors."""

import json
from pathlib import Path

import pytest
from crccheck.crc import CrcX25
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.core.wire import crc16_x25
from ccr_host.link.framing import Frame, FrameDecoder, FramingError, encode_frame
from ccr_host.link.messages import FRAME_OVERHEAD, MAX_AXES, MAX_PAYLOAD

VECTORS = json.loads((Path(__file__).parents[3] / "protocol" / "vectors.json").read_text())

LONGEST = MAX_PAYLOAD.of(MAX_AXES)
MAX_ENCODED_FRAME = LONGEST + FRAME_OVERHEAD + 1
payloads = st.binary(max_size=LONGEST)
bytes_u8 = st.integers(0, 255)


@given(st.binary(max_size=64))
def test_crc_agrees_with_an_independent_one(data):
    assert crc16_x25(data) == CrcX25.calc(data)


@given(bytes_u8, bytes_u8, payloads)
def test_frame_comes_back_whole(message_id, sequence, payload):
    encoded = encode_frame(message_id, sequence, payload)
    assert encoded.count(0) == 1
    assert len(encoded) <= MAX_ENCODED_FRAME + 1
    assert FrameDecoder().feed(encoded) == [Frame(message_id, sequence, payload)]


@given(st.lists(st.one_of(st.binary(max_size=70), payloads.map(lambda p: encode_frame(1, 2, p)))))
def test_how_the_bytes_are_cut_does_not_matter(chunks):
    stream = b"".join(chunks)
    whole = FrameDecoder().feed(stream)
    bytewise = FrameDecoder()
    assert [item for byte in stream for item in bytewise.feed(bytes([byte]))] == whole
    chunked = FrameDecoder()
    assert [item for chunk in chunks for item in chunked.feed(chunk)] == whole


def test_endless_bytes_without_a_zero_are_not_kept():
    decoder = FrameDecoder()
    for _ in range(1000):
        assert decoder.feed(b"\x01" * 1000) == []
    assert len(decoder._unfinished) <= MAX_ENCODED_FRAME
    assert decoder.feed(b"\0") == [FramingError.BAD_SIZE]


@given(payloads, st.data())
def test_flipped_bit_never_gives_the_frame_as_it_was_not_sent(payload, data):
    encoded = bytearray(encode_frame(1, 2, payload))
    at = data.draw(st.integers(0, len(encoded) - 2))
    encoded[at] ^= 1 << data.draw(st.integers(0, 7))
    frames = [item for item in FrameDecoder().feed(bytes(encoded)) if isinstance(item, Frame)]
    assert all(len(frame.payload) != len(payload) for frame in frames)  # the length check gets it


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_golden_vectors(cut):
    assert len(VECTORS["vectors"]) >= 200
    for vector in VECTORS["vectors"]:
        stream = bytes.fromhex(vector["stream"])
        decoder = FrameDecoder(MAX_PAYLOAD.of(vector["axes"]))
        found = []
        for begin in range(0, len(stream), cut):
            found += decoder.feed(stream[begin : begin + cut])
        assert found == [_expected(outcome) for outcome in vector["outcomes"]], vector["name"]


def test_golden_frames_are_encoded_to_their_wire_bytes():
    for vector in VECTORS["vectors"]:
        for outcome in vector["outcomes"]:
            if outcome["kind"] == "frame":
                frame = _expected(outcome)
                encoded = encode_frame(frame.id, frame.sequence, frame.payload)
                assert encoded.hex() == outcome["encoded"], vector["name"]


def _expected(outcome):
    if outcome["kind"] == "frame":
        return Frame(outcome["id"], outcome["sequence"], bytes.fromhex(outcome["payload"]))
    return FramingError(outcome["kind"])
