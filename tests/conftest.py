"""Options and reports that all tests share."""

from __future__ import annotations

from collections import defaultdict

import pytest

from ccr_host.link.messages import REQUIREMENTS

DEFAULT_DEVICES = ("emulator:", "simavr:")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--device",
        action="append",
        metavar="URI",
        help=f"board to hold to the conformance suite; default {', '.join(DEFAULT_DEVICES)}",
    )
    parser.addoption("--run-slow", action="store_true", help="also run the long campaigns")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "requirement(*ids): that the test shows, by spec.toml's ids")
    config.addinivalue_line("markers", "in_step: needs a board whose time is that of the test")


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
    covered: dict[str, set[str]] = defaultdict(set)
    for report in terminalreporter.stats.get("passed", []):
        for kind, value in report.user_properties:
            if kind == "requirement":
                device, name = value.split(" ")
                covered[device].add(name)
    for device, names in sorted(covered.items()):
        missing = [name for name in REQUIREMENTS if name not in names]
        terminalreporter.write_line(
            f"requirements shown on {device} {len(names)} of {len(REQUIREMENTS)}"
            + (f", not {', '.join(missing)}" if missing else "")
        )
