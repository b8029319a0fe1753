"""One suite for every implementation of the board.

    pytest tests/conformance                       emulator and firmware binary
    pytest tests/conformance --device simavr:      one of them
    pytest tests/conformance --device mega2560:    the binary for a Mega, built for two axes
    pytest tests/conformance --device serial:PORT  a board; it is armed and its servos are moved

Each test of a requirement names it; the suite prints which were shown, and why others were not.
A test is written once. It is exact to a tick on every board (see observer.py); what takes pins, a
prepared EEPROM or another reset than that of a port is skipped on a port, with that reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing

import pytest

from ccr_host.core.errors import CcrError
from ccr_host.link import messages as m
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.device import IN_STEP
from tests.conformance.found_board import FoundBoard
from tests.conformance.host import Host

MakeHost = Callable[..., Host]
HOW_LEFT = pytest.StashKey[dict[str, str]]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[HOW_LEFT] = {}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """On a port, run tests that need an unconfigured board before those that save."""
    items.sort(key=lambda item: not (_on_a_port(item) and "unconfigured" in item.fixturenames))


def pytest_report_header(config: pytest.Config) -> list[str]:
    return [
        f"{uri} will be armed and its servos moved over their whole range: tendons off, "
        "servo supply off or servos free to turn"
        for uri in config.getoption("--device") or ()
        if uri not in IN_STEP
    ]


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    for uri, how_left in config.stash[HOW_LEFT].items():
        terminalreporter.write_line(f"{uri} was left {how_left}")


@pytest.fixture(scope="session")
def found_board(request: pytest.FixtureRequest) -> Iterator[Callable[[str], FoundBoard]]:
    """The board on a port, opened once; the session ends here if there is none."""
    boards: dict[str, FoundBoard] = {}

    def find(uri: str) -> FoundBoard:
        if uri not in boards:
            try:
                boards[uri] = FoundBoard(uri)
            except CcrError as error:
                pytest.exit(str(error), returncode=error.exit_status)
        return boards[uri]

    yield find
    for uri, board in boards.items():
        request.config.stash[HOW_LEFT][uri] = board.leave()


@pytest.fixture
def make_host(
    device_uri: str,
    request: pytest.FixtureRequest,
    found_board: Callable[[str], FoundBoard],
) -> Iterator[MakeHost]:
    """A host of a board.

    In step it has just been started, and may be given an EEPROM and clocks to start from. On a
    port it is the one that the test before has used.
    """
    with ExitStack() as stack:

        def start(eeprom: EepromImage | None = None, **start_values: int) -> Host:
            device = IN_STEP[device_uri](eeprom or EepromImage(), **start_values)
            return Host(stack.enter_context(closing(device)))

        def take() -> Host:
            try:
                host = found_board(device_uri).host()
            except CcrError as error:
                pytest.exit(str(error), returncode=error.exit_status)
            stack.callback(host.make_safe)
            return host

        if device_uri in IN_STEP:
            yield start
        elif (marker := request.node.get_closest_marker("in_step")) is not None:
            pytest.skip(marker.args[0])
        else:
            yield take


@pytest.fixture
def listening(make_host: MakeHost) -> Host:
    """A host of a board in any state, without a session."""
    return make_host()


@pytest.fixture
def started(listening: Host) -> Host:
    """Just reset."""
    if not listening.device.in_step:
        listening.reset()
    return listening


@pytest.fixture
def in_boot(listening: Host) -> Host:
    """Just reset, and still in `boot`."""
    if not listening.device.in_step:
        listening.reset_into_boot()
    return listening


@pytest.fixture
def unconfigured(started: Host) -> Host:
    """Started, in `disarmed`, with a session, not configured."""
    started.boot()
    started.open_session()
    if started.report().flags & m.StatusFlags.CONFIGURED:
        pytest.skip("the board has a configuration in its EEPROM")
    return started


@pytest.fixture
def with_session(listening: Host) -> Host:
    """A host of a board in `disarmed`, at rest; configured or not."""
    listening.boot()
    listening.open_session()
    listening.clear_latch()
    listening.forget_setpoint()
    return listening


@pytest.fixture
def host(with_session: Host) -> Host:
    """A host of a board that can be armed."""
    with_session.configure()
    return with_session


@pytest.fixture
def armed(host: Host) -> Host:
    """A host of a board in `hold`, at rest."""
    host.arm()
    return host


@pytest.fixture
def may_save(
    device_uri: str, request: pytest.FixtureRequest, found_board: Callable[[str], FoundBoard]
) -> None:
    """Requested by tests that write to the EEPROM."""
    if device_uri in IN_STEP or request.config.getoption("--write-eeprom"):
        return
    if not found_board(device_uri).can_be_saved_again:
        pytest.skip("the EEPROM is blank, which a save would end: --write-eeprom allows it")


def _on_a_port(item: pytest.Item) -> bool:
    uri = item.callspec.params.get("device_uri") if hasattr(item, "callspec") else None
    return uri is not None and uri not in IN_STEP
