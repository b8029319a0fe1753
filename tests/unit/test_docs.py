"""What the docs promise to cover is there."""

import re
from pathlib import Path

import pytest

from ccr_host.link.messages import REQUIREMENTS, Fault

ROOT = Path(__file__).parents[2]
FAULT_PAGES = ROOT / "docs" / "faults"


@pytest.mark.parametrize("fault", [fault for fault in Fault if fault is not Fault.NONE])
def test_every_fault_has_a_page_with_reason_and_cure(fault: Fault) -> None:
    name = fault.name.lower()
    page = (FAULT_PAGES / f"{name}.md").read_text()
    assert page.startswith(f"# {name} ({fault.value})\n")
    for heading in ("**What happened.**", "**Why.**", "**Cure.**"):
        assert heading in page
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


def test_safety_names_requirements_that_exist() -> None:
    named = re.findall(r"\b[A-Z]{3}-\d+\b", (ROOT / "SAFETY.md").read_text())
    assert named
    assert set(named) <= set(REQUIREMENTS)
