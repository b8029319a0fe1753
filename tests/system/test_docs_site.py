"""The pages of docs/ as a site: builds without a warning, and no page is out of reach."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

DOCS = Path(__file__).parents[2] / "docs"


class Page(HTMLParser):
    """What an HTML page links to, and the anchors that it has."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.targets: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(file.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.anchors |= {value for key in ("id", "name") if (value := given.get(key))}
        target = given.get({"a": "href", "img": "src"}.get(tag, ""))
        if target and not urlsplit(target).scheme:
            self.targets.add(target)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, Page]:
    site = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", str(DOCS), str(site)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return {file: Page(file) for file in site.rglob("*.html") if "_static" not in file.parts}


def led_to(file: Path, target: str) -> tuple[Path, str]:
    parts = urlsplit(target)
    path = unquote(parts.path)
    return (file.parent / path).resolve() if path else file, parts.fragment


def test_every_page_is_reachable_from_the_first(pages: dict[Path, Page]) -> None:
    site = next(iter(pages)).parents[0]
    while not (site / "searchindex.js").exists():
        site = site.parent
    reached, waiting = set[Path](), [site / "index.html"]
    while waiting:
        file = waiting.pop()
        if file in pages and file not in reached:
            reached.add(file)
            waiting += [led_to(file, target)[0] for target in pages[file].targets]
    written = {page.relative_to(DOCS).with_suffix(".html") for page in DOCS.rglob("*.md")}
    assert written
    assert written <= {file.relative_to(site) for file in reached}


def test_the_notebook_runs_from_top_to_bottom_while_its_page_is_made(
    pages: dict[Path, Page],
) -> None:
    (page,) = (file for file in pages if file.stem == "first-steps")
    printed = re.findall(r"(?:mpc: |open loop: )?mean error \d+\.\d mm", page.read_text())
    assert [line.split(" mean")[0].rstrip(":") for line in printed[:2]] == ["mpc", "open loop"]
    assert len(printed) == 3
    assert page.read_text().count("data:image/png;base64") == 1


def test_links_and_pictures_of_the_site_are_there(pages: dict[Path, Page]) -> None:
    broken = [
        f"{file.name} -> {target}"
        for file, page in pages.items()
        for target in page.targets
        if not is_there(pages, *led_to(file, target))
    ]
    assert not broken


def is_there(pages: dict[Path, Page], file: Path, anchor: str) -> bool:
    if file not in pages:
        return file.exists()
    return not anchor or anchor in pages[file].anchors
