"""The session with a Polaris, from the first byte to the endless stream of frames."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

from ccr_host.core.errors import TrackerError
from ccr_host.tracking.sources.ndi.device_errors import BAD_COMMAND_CRC, NOT_INITIALISED
from ccr_host.tracking.sources.ndi.replies import (
    REPLY_MODE,
    CommandRefusedError,
    DamagedReplyError,
    TxReply,
    encode_command,
    parse_tx,
)
from ccr_host.tracking.sources.ndi.rom import dummy_passive_rom, rom_blocks
from ccr_host.tracking.sources.ndi.script import (
    Conversation,
    NoReplyError,
    NotACameraError,
    Reply,
    Script,
    Wait,
)

RESET_BAUD = 9600
FAST_BAUD = 115_200
_FAST_BAUD_ARGUMENTS = "50000"
"""115200 baud, 8 data bits, no parity, 1 stop bit, no handshake."""
_KNOWN_BAUDS = (RESET_BAUD, FAST_BAUD, 921_600, 230_400, 57_600, 38_400, 19_200, 14_400, 1_228_739)
"""All rates that COMM of a Polaris can set, the usual ones first."""

_BREAK_US = 300_000
"""A break is any low level longer than a byte; 250 ms is what serial drivers send."""
_RESET_TIMEOUT_US = 7_000_000
"""The waiting time in NDI's samples."""
_LINES_BEFORE_RESET = 10
_PROBE_TIMEOUT_US = 300_000
_TIMEOUT_US = 2_000_000
_BAUD_CHANGE_US = 100_000
"""The device answers COMM at the old rate and changes within this time (API guide)."""
_TX_TIMEOUT_US = 400_000
"""The longest reply, 50 strays and 6 tools, takes 130 ms at 115200 baud."""
_ATTEMPTS = 3
_DAMAGED_IN_A_ROW = 20
"""More damaged replies than noise explains: the device may have been reset to its slow rate."""
_DONE = "OKAY"
_RESET = "RESET"
"""The reply of a device that has just been reset, to any command."""
_FRESH_FRAMES = "80"
"""Argument of TSTART: count frames from 0."""
_WARNING_RESERVED_BITS = "WARNING05"
"""PINIT found reserved bits set in the .rom; the tool works."""

_HANDLE = re.compile("[0-9A-F]{2}")
_HANDLES = re.compile("[0-9A-F]{2}([0-9A-F]{5})*")
"""Their number, then handle and status of each."""
_SHOWN_CHARACTERS = 24

Talk = Generator[Wait, Reply | None, Reply]
ReplySink = Callable[[TxReply, Reply], int]
"""Called with a reply; returns the pause until the next poll, us."""


@dataclass(frozen=True)
class Tool:
    """A rigid body to be tracked."""

    name: str
    rom: bytes


@dataclass
class SessionLog:
    """What a session reports while it runs."""

    doing: str = "not started"
    tracking: bool = False
    baud: int = RESET_BAUD
    """Present rate of the line; without effect on TCP."""
    damaged_replies: int = 0
    warnings: tuple[str, ...] = ()
    """Warnings, one readable line each."""
    handles: dict[int, str] | None = None
    """Tool names by port handle."""


def session(
    line: Conversation, tools: Sequence[Tool], log: SessionLog, on_reply: ReplySink
) -> Script:
    """Make a device in any state track, and poll it forever.

    ``tools`` are tracked in addition to strays; if empty, a dummy lights the illuminators.
    ``on_reply`` is called with every parsed TX reply and returns the pause until the next poll in
    us.

    Raises:
        TrackerError: no camera, or one that refuses or fell silent; start a new session.
    """
    log.doing = "looking for the camera"
    log.baud = yield from _make_contact(line)
    log.doing = "initialising"
    yield from _initialise(line)
    if line.port.has_baud:
        yield from _hasten(line, log)
    log.doing = "loading tools"
    yield from _free_all_handles(line)
    log.handles = {}
    for tool in tools or (Tool("", dummy_passive_rom()),):
        handle = yield from _load(line, tool)
        log.handles[handle] = tool.name
    log.doing = "starting to track"
    yield from _order(line, "TSTART", _FRESH_FRAMES)
    log.doing = "tracking"
    log.tracking = True
    yield from _poll_for_ever(line, log, on_reply)


def farewell() -> bytes:
    """Commands that leave the device quiet; their replies are not awaited."""
    return encode_command("TSTOP")


def _make_contact(line: Conversation) -> Generator[Wait, Reply | None, int]:
    """Make the device ready for initialisation at the host's rate; returns that rate.

    A device that an earlier program left at another rate is reset by a break; if there is no break
    or it has no effect, the known rates are tried.
    """
    port = line.port
    if port.has_break:
        port.set_baud(RESET_BAUD)
        port.set_break(True)
        yield Wait(_BREAK_US)
        port.set_break(False)
        if (yield from _is_reset_heard()):
            return RESET_BAUD
    command, heard = encode_command("INIT"), b""
    for baud in _KNOWN_BAUDS if port.has_baud else (0,):
        try:
            port.set_baud(baud)
        except TrackerError:  # not every adapter has every rate
            continue
        for _ in range(2):  # a first command may be spoilt by what the wrong rates left behind
            line.say(command)
            try:
                if (yield from _hear(_PROBE_TIMEOUT_US)).text == _DONE:
                    return baud
                heard = heard or command
            except CommandRefusedError:
                return baud  # it speaks the language
            except DamagedReplyError as error:
                heard = heard or error.line
            except NoReplyError as error:
                heard = heard or error.unfinished
    raise NotACameraError(heard) if heard else NoReplyError()


def _is_reset_heard() -> Generator[Wait, Reply | None, bool]:
    for _ in range(_LINES_BEFORE_RESET):
        try:
            if (yield from _hear(_RESET_TIMEOUT_US)).text == _RESET:
                return True
        except NoReplyError:
            return False
        except (CommandRefusedError, DamagedReplyError):
            continue  # the end of an earlier conversation
    return False


def _hear(timeout_us: int) -> Talk:
    reply = yield Wait(timeout_us, for_reply=True)
    assert reply is not None
    return reply


def _initialise(line: Conversation) -> Generator[Wait, Reply | None, None]:
    try:
        yield from _order(line, "INIT")
    except CommandRefusedError:  # still tracking for an earlier program
        yield from _order(line, "TSTOP")
        yield from _order(line, "INIT")


def _hasten(line: Conversation, log: SessionLog) -> Generator[Wait, Reply | None, None]:
    """Request the fast rate; a camera that refuses it stays at its present rate."""
    try:
        yield from _order(line, "COMM", _FAST_BAUD_ARGUMENTS)
    except CommandRefusedError as refusal:
        log.warnings += (
            f"it stays at {log.baud} baud, with fewer frames a second: {refusal.cause}",
        )
        return
    yield Wait(_BAUD_CHANGE_US)
    line.port.set_baud(FAST_BAUD)
    log.baud = FAST_BAUD


def _free_all_handles(line: Conversation) -> Generator[Wait, Reply | None, None]:
    """Free all port handles, including those of an earlier program, which would fill the table."""
    handles = (yield from _talk(line, "PHSR", "00")).text
    if not _HANDLES.fullmatch(handles):
        raise _odd_answer(handles, "PHSR")
    for at in range(2, len(handles), 5):
        yield from _order(line, "PHF", handles[at : at + 2])


def _load(line: Conversation, tool: Tool) -> Generator[Wait, Reply | None, int]:
    """Upload, initialise and enable a passive tool; return its port handle."""
    handle = (yield from _talk(line, "PHRQ", "*********1****")).text
    if not _HANDLE.fullmatch(handle):
        raise _odd_answer(handle, "PHRQ")
    for address, block in rom_blocks(tool.rom):
        yield from _order(line, "PVWR", f"{handle}{address:04X}{block.hex().upper()}")
    outcome = yield from _talk(line, "PINIT", handle)
    if outcome.text not in (_DONE, _WARNING_RESERVED_BITS):
        raise TrackerError(
            f"tool {tool.name or 'dummy'} cannot be initialised: {outcome.text}",
            "check its .rom file",
        )
    yield from _order(line, "PENA", f"{handle}D")
    return int(handle, 16)


def _poll_for_ever(line: Conversation, log: SessionLog, on_reply: ReplySink) -> Script:
    command = encode_command("TX", REPLY_MODE)
    timeout_us = _TX_TIMEOUT_US if log.baud >= FAST_BAUD else _TIMEOUT_US
    silent = damaged = 0
    while True:
        line.say(command)
        text = ""
        try:
            reply = yield from _hear(timeout_us)
            text = reply.text
            parsed = parse_tx(text)
        except NoReplyError:
            silent += 1
            if silent == _ATTEMPTS:
                raise
        except (DamagedReplyError, CommandRefusedError) as error:
            _pass_on_unless_noise(error)
            damaged += 1
            log.damaged_replies += 1
            if damaged == _DAMAGED_IN_A_ROW:
                if text:
                    raise _odd_answer(text, "TX") from None
                raise
        else:
            silent = damaged = 0
            yield Wait(on_reply(parsed, reply))


def _talk(line: Conversation, name: str, arguments: str = "") -> Talk:
    """Request until a complete reply comes; every command used here may be repeated."""
    command = encode_command(name, arguments)
    for attempt in range(1, _ATTEMPTS + 1):
        line.say(command)
        try:
            reply = yield from _hear(_TIMEOUT_US)
            break
        except (DamagedReplyError, NoReplyError, CommandRefusedError) as error:
            _pass_on_unless_noise(error)
            if attempt == _ATTEMPTS:
                raise
    if reply.text == _RESET:  # the camera was reset meanwhile
        raise CommandRefusedError(NOT_INITIALISED)
    return reply


def _odd_answer(text: str, command: str) -> TrackerError:
    shown = text[:_SHOWN_CHARACTERS]
    return TrackerError(f"the camera answered {shown!r} to {command}", "power it off and on")


def _order(
    line: Conversation, name: str, arguments: str = ""
) -> Generator[Wait, Reply | None, None]:
    """Make a request whose reply must be OKAY."""
    answer = (yield from _talk(line, name, arguments)).text
    if answer != _DONE:
        raise _odd_answer(answer, name)


def _pass_on_unless_noise(error: TrackerError) -> None:
    """Raise an error unless it is a damaged command or reply, which a repetition cures."""
    if isinstance(error, CommandRefusedError) and error.code != BAD_COMMAND_CRC:
        raise error
