"""docs/architecture.md and docs/extending.md describe the code as it is."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ccr_host.run.execute import execute_quietly
from ccr_host.run.options import RunOptions
from tests.unit.test_layers import HOUSE, LAYER, imported

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGE = (DOCS / "architecture.md").read_text(encoding="utf-8")
CODE_FILE = r"`((?:\w+/)+(?:\w+\.(?:py|cpp|h|toml|json)))`"


def section(heading: str) -> str:
    return PAGE.partition(f"## {heading}\n")[2].partition("\n## ")[0]


def test_the_table_has_the_layers_that_imports_are_held_to() -> None:
    rows = re.findall(r"^\| (\d) \| (.*?) \|", section("The layers"), re.M)
    told = {n.strip("/"): int(layer) for layer, cell in rows for n in re.findall(r"`(.*?)`", cell)}
    assert told == LAYER


def imports_of_packages() -> dict[str, set[str]]:
    """Which packages each one imports, also where it does so by name."""
    edges: dict[str, set[str]] = {package: set() for package in LAYER}
    for file in HOUSE.rglob("*.py"):
        package = file.relative_to(HOUSE).parts[0].removesuffix(".py")
        source = file.read_text(encoding="utf-8")
        names = [*imported(source), *re.findall(r'import_module\("(ccr_host\.\w+)', source)]
        edges[package] |= {f"{name}.".split(".")[1] for name in names} - {package, ""}
    return edges


def reached(edges: dict[str, set[str]], package: str) -> set[str]:
    return edges[package].union(*(reached(edges, other) for other in edges[package]))


def test_every_arrow_of_the_drawing_is_an_import_and_every_import_follows_from_arrows() -> None:
    edges = imports_of_packages()
    needed = {
        (package, other)
        for package in edges
        for other in edges[package]
        if not any(other in reached(edges, between) for between in edges[package])
    }
    assert set(re.findall(r"^ +(\w+) --> (\w+)$", section("The layers"), re.M)) == needed


def test_no_file_is_too_long_to_be_read_at_once_but_the_generated_one() -> None:
    lines = {f: len(f.read_text("utf-8").splitlines()) for f in HOUSE.rglob("*.py")}
    assert {file.name for file, count in lines.items() if count > 400} == {"messages.py"}


def sample_steps() -> list[tuple[str, str, str]]:
    rows = re.findall(r"^\| .*? \| `(\S+)` \| `(\S+)` \| (.*?) \|$", PAGE, re.M)
    assert len(rows) > 20
    return rows


def calls_of(options: RunOptions) -> Iterator[tuple[str, str]]:
    """Files and functions that a run calls."""
    called = set()

    def note(frame, _event, _argument) -> None:
        called.add(frame.f_code)

    before = sys.gettrace()
    sys.settrace(note)
    try:
        result = execute_quietly(options)
    finally:
        sys.settrace(before)
    assert result.failure is None
    for code in called:
        file = Path(code.co_filename)
        if HOUSE in file.parents:
            yield file.relative_to(HOUSE).as_posix(), code.co_qualname


@pytest.mark.long
def test_every_call_on_a_samples_way_to_a_pulse_is_made(tmp_path: Path) -> None:
    path = tmp_path / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,30\n1,0,32\n")
    made = set()
    runs = ("mpc", "ndi-emulator:", ()), ("adaptive", "twin:", ("control.solver=compiled",))
    for controller, tracker, overrides in runs:
        run = RunOptions(
            path=str(path), controller=controller, tracker=tracker, rate_hz=2.0, overrides=overrides
        )
        made |= set(calls_of(run))
    missing = [(call, file) for call, file, _ in sample_steps() if (file, call) not in made]
    assert not missing


@pytest.mark.parametrize("page", ["architecture.md", "extending.md"])
def test_every_file_that_is_named_is_there(page: str) -> None:
    named = re.findall(CODE_FILE, (DOCS / page).read_text(encoding="utf-8"))
    missing = [n for n in named if not ((HOUSE / n).exists() or (ROOT / n).exists())]
    assert not missing
    assert len(named) > 10


@pytest.mark.parametrize(("page", "folder"), [("twin.md", "robot"), ("simavr.md", "simavr")])
def test_the_modules_that_a_page_lists_are_those_of_its_folder(page: str, folder: str) -> None:
    table = (DOCS / page).read_text(encoding="utf-8").partition("|---|---|\n")[2].partition("\n\n")
    listed = set(re.findall(r"`(\w+\.py)`", re.sub(r"(?m)^\| (.*?) \|.*$", r"\1", table[0])))
    there = {file.name for file in (HOUSE / "sim" / folder).glob("*.py")} - {"__init__.py"}
    assert listed == there
