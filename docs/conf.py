"""The pages of docs/ as a site: sphinx-build -W docs build/docs."""

project = "ccr-host"
copyright = "2026, the authors of ccr-host"  # noqa: A001 - Sphinx wants this name
extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
html_theme = "furo"
html_title = "ccr-host"
myst_heading_anchors = 3
highlight_language = "none"
# Links to files of the checkout are checked by tests/unit/test_docs.py.
suppress_warnings = ["myst.xref_missing"]
