"""The pages of docs/ as a site: scripts/docs."""

from __future__ import annotations

import base64
import io
import json
import logging
import re
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

import matplotlib.pyplot as plt
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


# A style that Sphinx loads (a11y_pygments) turns on everybody's INFO: a line per font table.
logging.getLogger("fontTools").setLevel(logging.WARNING)

NOTEBOOKS = {"first-steps": "first_steps.ipynb"}
"""Pages that show a notebook of examples/, executed while the site is built."""


def show_notebook(_app: Sphinx, page: str, source: list[str]) -> None:
    """Make the page of a notebook from its cells and what they print and plot."""
    if page in NOTEBOOKS:
        file = Path(__file__).parents[1] / "examples" / NOTEBOOKS[page]
        cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
        names: dict[str, Any] = {}
        with tempfile.TemporaryDirectory() as folder, chdir(folder):
            shown = [markdown_of(cell, names) for cell in cells]
        source[0] = "\n\n".join(shown).replace("](../docs/", "](")


def markdown_of(cell: dict[str, Any], names: dict[str, Any]) -> str:
    """A cell; code is executed with the names of the cells before, its output follows."""
    text = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return text
    shown, printed = [f"```python\n{text}\n```"], io.StringIO()
    with redirect_stdout(printed), patch.object(plt, "show"):
        exec(text, names)
    if printed.getvalue():
        shown.append(f"```none\n{printed.getvalue()}```")
    for number in plt.get_fignums():
        picture = io.BytesIO()
        plt.figure(number).savefig(picture, bbox_inches="tight")
        code = base64.b64encode(picture.getvalue()).decode()
        shown.append(f"![](data:image/png;base64,{code})")
    plt.close("all")
    return "\n\n".join(shown)


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", show_notebook)
    app.connect("source-read", lead_to_pages)
