"""The pages of docs/ as a site: scripts/docs."""

from __future__ import annotations

import re

from sphinx.application import Sphinx

project = "ccr-host"
copyright = "2026, the authors of ccr-host"  # noqa: A001 - Sphinx wants this name
extensions = ["myst_parser", "sphinxcontrib.mermaid"]
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


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", lead_to_pages)
