"""The golden vectors against packages that know nothing of this project: `cobs` and `crccheck`."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest
from cobs import cobs
from crccheck.crc import CrcX25

_LONGEST = {1: 48 + 4, 2: 48 + 4, 4: 98 + 4, 6: 98 + 4, 12: 98 + 4}
"""Bytes of the longest frame, by the axes of the board."""


def _judge(chunk: bytes, axes: int) -> tuple[str, bytes]:
    """What independent packages say of the bytes between two zeros, and the decoded frame."""
    if len(chunk) > _LONGEST[axes] + 1:
        return "bad_size", b""
    try:
        content = cobs.decode(chunk)
    except cobs.DecodeError:
        return "bad_encoding", b""
    if len(content) < 4:
        return "bad_size", b""
    crc = CrcX25.calc(content[:-2])
    return ("frame" if content[-2:] == crc.to_bytes(2, "little") else "bad_crc"), content


def _chunks(vector: dict[str, Any]) -> Iterator[bytes]:
    *chunks, _ = bytes.fromhex(vector["stream"]).split(b"\0")
    return filter(None, chunks)


def test_independent_packages_find_the_same_outcomes(vectors) -> None:
    for vector in vectors:
        judged = [_judge(chunk, vector["axes"]) for chunk in _chunks(vector)]
        expected = vector["outcomes"]
        assert [kind for kind, _ in judged] == [outcome["kind"] for outcome in expected], vector
        for (kind, content), outcome in zip(judged, expected, strict=True):
            if kind == "frame":
                assert outcome["id"] == content[0]
                assert outcome["sequence"] == content[1]
                assert outcome["payload"] == content[2:-2].hex()


def test_independent_packages_encode_each_frame_to_the_same_bytes(vectors) -> None:
    for vector in vectors:
        for outcome in vector["outcomes"]:
            if outcome["kind"] == "frame":
                body = bytes([outcome["id"], outcome["sequence"]])
                body += bytes.fromhex(outcome["payload"])
                content = body + CrcX25.calc(body).to_bytes(2, "little")
                assert outcome["encoded"] == (cobs.encode(content) + b"\0").hex()


def test_names_are_unique_and_there_are_enough_vectors_of_each_kind(vectors) -> None:
    names = [vector["name"] for vector in vectors]
    assert len(set(names)) == len(names) >= 300
    kinds = Counter(outcome["kind"] for vector in vectors for outcome in vector["outcomes"])
    assert kinds.keys() == {"frame", "bad_crc", "bad_encoding", "bad_size"}
    assert min(kinds.values()) >= 20


def test_boards_of_one_to_twelve_axes_have_vectors_of_their_own(vectors) -> None:
    by_axes = Counter(vector["axes"] for vector in vectors)
    assert by_axes.keys() == _LONGEST.keys()
    assert min(by_axes.values()) >= 100
    for axes in _LONGEST:
        (target,) = (
            vector["outcomes"][0]
            for vector in vectors
            if vector["axes"] == axes and vector["name"].endswith("set_target: typical")
        )
        assert len(target["fields"]["target_cdeg"]) == axes
        assert len(target["payload"]) == 2 * (6 + 2 * axes)


@pytest.mark.parametrize(
    "subject",
    [
        "two frames abutting",
        "two frames without the zero between",
        "last CRC byte zero",
        "longest payload",
        "payload of 0xFF",
        "many zeros",
        "code byte beyond the end, then a frame",
        "byte 3 dropped, then a frame",
        "byte 3 doubled, then a frame",
        "byte 3 zeroed, then a frame",
        "byte 3, bit 5 flipped, then a frame",
        "cut before byte 3, then a frame",
        "1000 bytes without a zero, then a frame",
    ],
)
def test_the_awkward_cases_are_among_them(vectors, subject: str) -> None:
    assert subject in {vector["name"] for vector in vectors}


def test_every_message_has_its_extremes_and_every_enum_field_a_value_too_many(
    vectors, tree
) -> None:
    names = {vector["name"] for vector in vectors}
    for message in tree["message"]:
        own = f"{message['name']}: "
        variants = {name.removeprefix(own) for name in names if name.startswith(own)}
        assert {"least", "greatest", "typical"} <= variants or "empty" in variants
    undefined = [o for v in vectors for o in v["outcomes"] if o.get("reading") == "undefined_value"]
    assert len(undefined) >= 20
