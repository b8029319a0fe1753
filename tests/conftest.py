"""Options and reports that all tests share."""

from __future__ import annotations

import signal

import pytest

from ccr_host.link.messages import REQUIREMENTS
from tests.requirement_coverage import Coverage

DEFAULT_DEVICES = ("emulator:", "simavr:")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--device",
        action="append",
        metavar="URI",
        help=f"board to hold to the conformance suite; default {', '.join(DEFAULT_DEVICES)}",
    )
    parser.addoption(
        "--write-eeprom",
        action="store_true",
        help="also test saving on a board with a blank EEPROM, which does not stay blank then",
    )
    parser.addoption("--run-slow", action="store_true", help="also run the long campaigns")


def pytest_configure(config: pytest.Config) -> None:
    # A shell's background jobs ignore Ctrl-C, and so would all the commands that they start.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    config.addinivalue_line("markers", "requirement(*ids): that the test shows, by spec.toml's ids")
    config.addinivalue_line("markers", "in_step(reason): why it takes a simulator in step with it")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "device_uri" in metafunc.fixturenames:
        uris = metafunc.config.getoption("--device") or DEFAULT_DEVICES
        metafunc.parametrize("device_uri", uris)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        for marker in item.iter_markers("requirement"):
            unknown = set(marker.args) - set(REQUIREMENTS)
            assert not unknown, (
                f"{item.nodeid} names requirements the spec does not have: {unknown}"
            )
            parameters = item.callspec.params if hasattr(item, "callspec") else {}
            uri = parameters.get("device_uri", "emulator:")
            item.user_properties += [("requirement", f"{uri} {name}") for name in marker.args]
        if "slow" in item.keywords and not config.getoption("--run-slow"):
            item.add_marker(pytest.mark.skip(reason="a long campaign: --run-slow runs it"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    coverage = Coverage()
    for outcome in ("passed", "failed", "error", "skipped"):
        for report in terminalreporter.stats.get(outcome, []):
            reason = str(report.longrepr[2]) if outcome == "skipped" else ""
            for kind, value in getattr(report, "user_properties", ()):  # none if collecting failed
                if kind == "requirement":
                    board, name = value.split(" ")
                    coverage.note(board, name, report.outcome, reason.removeprefix("Skipped: "))
    for line in coverage.lines():
        terminalreporter.write_line(line)
