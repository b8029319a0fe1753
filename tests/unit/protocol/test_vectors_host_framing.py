"""The golden vectors against the host's frame codec."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.link.framing import FrameDecoder, FramingError, encode_frame
from ccr_host.link.messages import MAX_AXES, MAX_PAYLOAD


def _outcome(found: Any) -> dict[str, Any]:
    if isinstance(found, FramingError):
        return {"kind": found.name.lower()}
    return {
        "kind": "frame",
        "id": found.id,
        "sequence": found.sequence,
        "payload": found.payload.hex(),
    }


def _expected(vector: dict[str, Any]) -> list[dict[str, Any]]:
    keys = ("kind", "id", "sequence", "payload")
    return [{key: outcome[key] for key in keys if key in outcome} for outcome in vector["outcomes"]]


@pytest.mark.parametrize("step", [1, 7, 100_000], ids=["bytewise", "in pieces", "at once"])
def test_the_host_makes_of_each_stream_what_it_should(vectors, step: int) -> None:
    for vector in vectors:
        stream = bytes.fromhex(vector["stream"])
        decoder = FrameDecoder(MAX_PAYLOAD.of(vector["axes"]))
        found = [
            _outcome(outcome)
            for start in range(0, len(stream), step)
            for outcome in decoder.feed(stream[start : start + step])
        ]
        assert found == _expected(vector), vector["name"]


def test_the_host_encodes_each_frame_to_the_same_bytes(vectors) -> None:
    frames = [o for v in vectors for o in v["outcomes"] if o["kind"] == "frame"]
    for frame in frames:
        payload = bytes.fromhex(frame["payload"])
        assert encode_frame(frame["id"], frame["sequence"], payload).hex() == frame["encoded"]
    assert len(frames) > 200


@given(
    noise=st.binary(max_size=300),
    identity=st.tuples(st.integers(0, 255), st.integers(0, 255)),
    payload=st.binary(max_size=MAX_PAYLOAD.of(MAX_AXES)),
)
def test_after_any_noise_and_a_zero_the_next_frame_is_understood(noise, identity, payload) -> None:
    decoder = FrameDecoder()
    decoder.feed(noise + b"\0")
    (frame,) = decoder.feed(encode_frame(*identity, payload))
    assert not isinstance(frame, FramingError)
    assert (frame.id, frame.sequence, frame.payload) == (*identity, payload)
