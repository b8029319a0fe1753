"""The docs are complete and consistent with the code."""

import ast
import importlib
import json
import re
import textwrap
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ccr_host.control import base
from ccr_host.core import __version__
from ccr_host.description import schema
from ccr_host.link.device_errors import BoardFaultError
from ccr_host.link.messages import Fault
from ccr_host.run.execute import reference_of
from ccr_host.run.options import RunOptions
from ccr_host.tools.jog import CLEAR
from tests.firmware.pins.mutants import AT_THE_PINS, IN_THE_HOST, INSIDE
from tests.requirement_coverage import REQUIREMENTS

ROOT = Path(__file__).parents[2]
FAULT_PAGES = ROOT / "docs" / "faults"


@pytest.mark.parametrize("fault", [fault for fault in Fault if fault is not Fault.NONE])
def test_every_fault_has_a_page_with_reason_and_cure(fault: Fault) -> None:
    name = fault.name.lower()
    page = (FAULT_PAGES / f"{name}.md").read_text()
    assert page.startswith(f"# {name} ({fault.value})\n")
    for heading in ("**What happened.**", "**Why.**", "**Cure.**"):
        assert heading in page
    told = page.partition("**Clear it** with ")[2].partition(",")[0]
    assert told == "`ccr-host jog --device serial:/dev/ttyACM0` and its key `c`"
    assert "c" in CLEAR
    assert "key c of: ccr-host jog" in BoardFaultError(fault).cure
    assert f"[{name}]({name}.md)" in (FAULT_PAGES / "README.md").read_text()


def test_links_between_pages_lead_somewhere() -> None:
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "protocol" / "README.md"]
    broken = [
        f"{page.relative_to(ROOT)} -> {target}"
        for page in pages
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text())
        if not (page.parent / target).exists()
    ]
    assert not broken


def test_the_script_of_the_pictures_imports_what_exists() -> None:
    """It is run by hand and has no ending for the type checker to see."""
    tree = ast.parse((ROOT / "scripts" / "pictures").read_text())
    ours = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("ccr_host")
    ]
    assert ours
    for node in ours:
        module = importlib.import_module(str(node.module))
        assert {alias.name for alias in node.names} <= set(dir(module))


def test_safety_names_requirements_that_exist() -> None:
    named = re.findall(r"\b[A-Z]{3}-\d+\b", (ROOT / "SAFETY.md").read_text())
    assert named
    assert set(named) <= set(REQUIREMENTS)


def test_safety_names_tests_that_exist() -> None:
    named = re.findall(r"`(test_\w+)(?:\.py)?`", (ROOT / "SAFETY.md").read_text())
    files = list((ROOT / "tests").rglob("test_*.py"))
    there = {file.stem for file in files}
    there |= {name for file in files for name in re.findall(r"def (test_\w+)", file.read_text())}
    assert len(named) > 20
    assert set(named) <= there


def test_every_seeded_fault_and_what_notices_it_is_in_the_table() -> None:
    page = (ROOT / "docs" / "firmware.md").read_text()
    for mutant in AT_THE_PINS + INSIDE + IN_THE_HOST:
        noticed = mutant.noticed_by.rpartition("::")[2]
        told = f"`{noticed}`" if noticed.startswith("test_") else noticed.replace("|", " or ")
        assert re.search(rf"^\| {mutant.name} \| (oracle: )?{told} \|$", page, re.M), mutant.name


@pytest.mark.parametrize("folder", ["host", "bench", "docs", "examples", "tests"])
def test_docstrings_are_statements_and_not_the_end_of_one(folder: str) -> None:
    """`Of each marker` says nothing without the name above it; messages quote the spec."""
    dangling = []
    for file in set((ROOT / folder).rglob("*.py")) - {ROOT / "host/ccr_host/link/messages.py"}:
        for node in ast.walk(ast.parse(file.read_text())):
            match node:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    if text.split(" ")[0] in {"Of", "By", "From", "As", "With"}:
                        dangling.append(f"{file.relative_to(ROOT)}:{node.lineno}: {text}")
    assert not dangling


def quoted_messages() -> list[str]:
    """Messages quoted in the first column of the troubleshooting tables."""
    lines = (ROOT / "docs" / "troubleshooting.md").read_text().splitlines()
    symptoms = [line.split("|")[1] for line in lines if line.startswith("| ")]
    spans = [span for symptom in symptoms for span in re.findall(r"`([^`]+)`", symptom)]
    return [span for span in spans if " " in span]


def strings_of_the_host() -> list[str]:
    """Every string of the source; what is filled in is left out."""
    found = []
    for file in (ROOT / "host").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.JoinedStr):
                parts = [part.value for part in node.values if isinstance(part, ast.Constant)]
                found.append("\0".join(str(part) for part in parts))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return found


def test_messages_quoted_in_troubleshooting_are_those_of_the_host() -> None:
    quoted, strings = quoted_messages(), strings_of_the_host()
    assert len(quoted) > 10
    unknown = []
    for message in quoted:
        pattern = re.compile(".*".join(re.escape(p.strip()) for p in message.split("...")), re.S)
        if not any(pattern.search(text) for text in strings):
            unknown.append(message)
    assert not unknown


def test_the_controller_shown_in_extending_follows_a_path() -> None:
    page = (ROOT / "docs" / "extending.md").read_text()
    blocks = re.findall(r"\n\n((?:(?:    .*)?\n)+)", page)
    shown = textwrap.dedent(next(block for block in blocks if "class Still" in block))
    names: dict[str, Any] = {}
    exec(shown, names)
    reference = reference_of(RunOptions(path="8shape"))
    controller = names["Still"](schema.load(None))
    commands = [controller.start(reference)]
    for step in range(1, len(reference)):
        seen = base.Observation(step, 0, None, 0, commands[-1].q_rad)
        commands.append(controller.step(seen))
    assert np.allclose([command.q_rad for command in commands], reference.q_rad)


def test_the_samples_of_a_description_are_read_as_they_stand() -> None:
    samples = [
        textwrap.dedent(block)
        for page in sorted((ROOT / "docs").rglob("*.md"))
        for block in re.findall(r"\n\n((?:(?: {4}.*)?\n)+)", page.read_text())
        if re.match(r"\s*\[+[a-z_]+\]+\n", block)
    ]
    assert len(samples) >= 3
    for sample in samples:
        schema.parse(sample)


def test_the_page_of_the_command_line_has_the_statuses_of_the_program_and_no_other() -> None:
    page = (ROOT / "docs" / "command-line.md").read_text()
    table = page.partition("| status | when |")[2].partition("\n\n")[0]
    assert [int(row) for row in re.findall(r"^\| (\d+) \|", table, re.M)] == [0, 2, 3, 130]


def test_every_extra_is_listed_for_newcomers() -> None:
    page = (ROOT / "docs" / "quick-start.md").read_text()
    table = page.partition("| extra | for |")[2].partition("\n\n")[0]
    listed = {name for row in re.findall(r"^\| (.*?) \|", table, re.M) for name in row.split(", ")}
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    assert listed - {"---"} == {f"`{name}`" for name in extras}


def test_no_page_contains_a_placeholder_for_this_repository() -> None:
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
    assert not [page.name for page in pages if re.search(r"git clone [A-Z]+\b", page.read_text())]


def test_the_release_has_one_number() -> None:
    citation = (ROOT / "CITATION.cff").read_text()
    library = json.loads((ROOT / "firmware" / "lib" / "core" / "library.json").read_text())
    assert f"\nversion: {__version__}\n" in citation
    assert library["version"] == __version__
