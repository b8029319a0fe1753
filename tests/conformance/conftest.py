"""One suite for every implementation of the board.

    pytest tests/conformance                       emulator and firmware binary
    pytest tests/conformance --device simavr:      one of them
    pytest tests/conformance --device serial:PORT  a board, servos off: it is armed and moved

Each test of a requirement names it; the suite prints which ones were covered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing

import pytest

from ccr_host.emulator.eeprom import EepromImage
from tests.conformance.device import IN_STEP, make_device
from tests.conformance.host import Host

MakeHost = Callable[..., Host]


@pytest.fixture
def make_host(device_uri: str, request: pytest.FixtureRequest) -> Iterator[MakeHost]:
    """A host of a board that has just been started; give it an EEPROM to start from."""
    in_step = device_uri in IN_STEP
    if not in_step and request.node.get_closest_marker("in_step"):
        pytest.skip("needs a board in step with the test")
    with ExitStack() as stack:

        def make(eeprom: EepromImage | None = None, **start_values: int) -> Host:
            device = make_device(device_uri, eeprom or EepromImage(), **start_values)
            return Host(stack.enter_context(closing(device)))

        yield make


@pytest.fixture
def blank(make_host: MakeHost) -> Host:
    """Started, in `disarmed`, with a session, not configured."""
    host = make_host()
    host.boot()
    host.open_session()
    return host


@pytest.fixture
def host(blank: Host) -> Host:
    """Ready to be armed."""
    blank.configure()
    return blank


@pytest.fixture
def armed(host: Host) -> Host:
    """In `hold`, at rest."""
    host.arm()
    return host
