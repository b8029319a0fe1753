"""The pages of docs/ as a site: scripts/docs."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

project = "ccr-host"
copyright = "2026, the authors of ccr-host"  # noqa: A001 - Sphinx wants this name
extensions = [
    "myst_parser",
    "sphinxcontrib.mermaid",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
]
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
source_suffix = {".md": "markdown"}
html_theme = "furo"
html_title = "ccr-host"
myst_heading_anchors = 3
myst_fence_as_directive = ["mermaid"]
highlight_language = "none"

PAGES_OF_FILES = {
    "SAFETY.md": "safety",
    "protocol/reference.md": "protocol",
    "bench/results.md": "bench-results",
}
"""Files of the checkout that a page of the site includes."""


def lead_to_pages(_app: Sphinx, _page: str, source: list[str]) -> None:
    """Links to files outside of docs/, right in the checkout, lead to their pages on the site."""
    for file, page in PAGES_OF_FILES.items():
        source[0] = re.sub(rf"\]\((?:\.\./)+{re.escape(file)}", f"](/{page}.md", source[0])


NOTEBOOKS = {"first-steps": "first_steps.ipynb"}
"""Pages that show a notebook of examples/ as it was run last."""


def show_notebook(_app: Sphinx, page: str, source: list[str]) -> None:
    """Pages of notebooks are made from their cells and what these have printed."""
    if page in NOTEBOOKS:
        file = Path(__file__).parents[1] / "examples" / NOTEBOOKS[page]
        cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
        source[0] = "\n\n".join(map(markdown_of, cells)).replace("](../docs/", "](")


def markdown_of(cell: dict[str, Any]) -> str:
    """A cell, with its text and pictures where it is code."""
    text = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return text
    shown = [f"```python\n{text}\n```"]
    for output in cell["outputs"]:
        if printed := "".join(output.get("text", ())):
            shown.append(f"```none\n{printed}```")
        if picture := "".join(output.get("data", {}).get("image/png", ())):
            shown.append(f"![](data:image/png;base64,{picture.strip()})")
    return "\n\n".join(shown)


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", show_notebook)
    app.connect("source-read", lead_to_pages)
