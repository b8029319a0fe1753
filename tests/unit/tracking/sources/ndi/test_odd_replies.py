"""Cameras whose replies are whole, but not what they should be."""

import re

import pytest

from ccr_host.core.wire import crc16_arc

FRAME = re.compile(r"([0-9A-F]{8})\n")
"""The frame number of a tool in a reply to TX."""


def whole(text: str) -> bytes:
    data = text.encode("ascii")
    return b"%s%04X\r" % (data, crc16_arc(data))


def alter(run, change) -> None:
    """Let ``change`` make another reply of the command's name and the reply's text."""
    line, received, asked = run.line, bytearray(), [""]
    write, read = line.write, line.read

    def noted(data: bytes) -> None:
        asked[0] = data.decode("latin1").partition(":")[0]
        write(data)

    def altered() -> bytes:
        received.extend(read())
        *lines, rest = bytes(received).split(b"\r")
        received[:] = rest
        return b"".join(whole(change(asked[0], one[:-4].decode("latin1"))) for one in lines)

    line.write, line.read = noted, altered


def only(command: str, answer: str):
    return lambda asked, text: answer if asked == command else text


@pytest.mark.parametrize("command", ["PHSR", "PHRQ", "PVWR", "PENA", "TSTART", "TX"])
@pytest.mark.parametrize("answer", ["BUSY", "WARNING", "okay"])
def test_an_unexpected_reply_is_shown_with_its_command(bench, command, answer):
    run = bench()
    alter(run, only(command, answer))
    run.run_ms(3000)
    assert f"the camera answered '{answer}' to {command}" in run.tracker.health.last_error


@pytest.mark.parametrize("command", ["PHSR", "PHRQ", "PVWR", "PINIT", "PENA", "TSTART"])
def test_a_camera_that_was_reset_says_so_in_answer_to_any_command(bench, command):
    run = bench()
    alter(run, only(command, "RESET"))
    run.run_ms(3000)
    assert "camera not initialised" in run.tracker.health.last_error


def test_replies_that_begin_with_a_line_feed_are_read(bench):
    run = bench()
    read = run.line.read
    run.line.read = lambda: read().replace(b"\r", b"\r\n")
    run.run_until_tracking()
    assert run.tracker.health.damaged_replies == 0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda text: "00" + text.partition("\n")[2], "it has forgotten its tools"),
        (lambda text: FRAME.sub("00000200\n", text), "their numbers do not count up"),
        (
            lambda text: FRAME.sub(lambda one: f"{99999 - int(one[1], 16):08X}\n", text),
            "their numbers do not count up",
        ),
    ],
)
def test_a_camera_that_answers_without_new_frames_is_started_again(bench, change, told):
    run = bench()
    run.run_until_tracking()
    healthy = False
    alter(run, lambda asked, text: text if healthy or asked != "TX" else change(text))
    run.run_ms(3500)
    assert f"shows no new frames for 3 s: {told}" in run.tracker.health.last_error
    healthy = True
    run.run_until_tracking()
    assert run.tracker.health.reconnections == 1
