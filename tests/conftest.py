"""Options and reports shared by all tests."""

from __future__ import annotations

import signal
import zlib
from collections import Counter
from collections.abc import Generator

import hypothesis
import pytest

from tests import without_posix
from tests.requirement_coverage import REQUIREMENTS, Coverage

DEFAULT_DEVICES = ("emulator:", "simavr:")


# An example may take any time on a busy machine. All runs draw the same examples, so that a change
# is judged by itself; the long campaigns draw new ones.
_EXAMPLES = hypothesis.settings(
    deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.register_profile("new", _EXAMPLES)
hypothesis.settings.register_profile("same", _EXAMPLES, derandomize=True)
hypothesis.settings.load_profile("same")


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
    parser.addoption(
        "--without-posix", action="store_true", help="hide what Windows lacks from tests and host"
    )


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--without-posix"):
        without_posix.hide()
    if config.getoption("--run-slow"):
        hypothesis.settings.load_profile("new")
    # A shell's background jobs ignore Ctrl-C, and so would all the commands that they start.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Under nohup, what the tests start would be deaf to it too.
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    config.addinivalue_line("markers", "requirement(*ids): that the test shows, by spec.toml's ids")
    config.addinivalue_line("markers", "in_step(reason): why it takes a simulator in step with it")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "device_uri" in metafunc.fixturenames:
        uris = metafunc.config.getoption("--device") or DEFAULT_DEVICES
        metafunc.parametrize("device_uri", uris)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # Files in an arbitrary but fixed order: while those that wait wait, others compute.
    items.sort(key=lambda item: zlib.crc32(item.nodeid.partition("::")[0].encode()))
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


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Only long campaigns may be skipped, and on a board that was named what it cannot do."""
    report = yield
    if report.skipped and "slow" not in item.keywords and not item.config.getoption("--device"):
        report.outcome = "failed"
        report.longrepr = f"{_reason(report)}: only tests marked slow may be skipped"
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    skipped = Counter(
        f"{report.nodeid.partition('[')[0]}: {_reason(report)}"
        for report in terminalreporter.stats.get("skipped", [])
    )
    for test, count in sorted(skipped.items()):
        terminalreporter.write_line(f"SKIPPED [{count}] {test}")
    coverage = Coverage()
    for outcome in ("passed", "failed", "error", "skipped"):
        for report in terminalreporter.stats.get(outcome, []):
            reason = _reason(report) if outcome == "skipped" else ""
            for kind, value in getattr(report, "user_properties", ()):  # none if collecting failed
                if kind == "requirement":
                    board, name = value.split(" ")
                    coverage.note(board, name, report.outcome, reason)
    for line in coverage.lines():
        terminalreporter.write_line(line)


def _reason(skipped: pytest.TestReport) -> str:
    assert isinstance(skipped.longrepr, tuple)
    return skipped.longrepr[2].removeprefix("Skipped: ")
