"""How every figure of this program looks: colours, names within it, formats in which it is kept."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

from ccr_host.core.user_file import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Metadata = dict[str, None]

DESIRED = "#999999"
UNREACHABLE = "#d55e00"
LIMIT = "#555555"
LOST = "#aaaaaa"
MOTORS = (
    *("#0072b2", "#cc79a7", "#009e73", "#e69f00", "#56b4e9", "#332288"),
    *("#882255", "#117733", "#999933", "#661100", "#6699cc", "#888888"),
)
"""A colour for each motor that a board can drive."""

_CONTROLLERS = {
    "open-loop": "#332288",
    "mpc": "#aa4499",
    "adaptive": "#117733",
    "pid-ik": "#cc6677",
    "broyden": "#88ccee",
    "kalman-jacobian": "#999933",
    "mpc-offset": "#44aa99",
}
"""Paul Tol's muted scheme, which people with colour blindness can tell apart."""
_OTHER_CONTROLLERS = ("#882255", "#ddcc77", "#6699cc", "#997700", "#994455", "#004488")
BESIDE_THE_TRUTH = 0.4
"""Opacity of what was measured where the true value is drawn, too."""
_DPI = 110
_LONGEST_NAME = 48
_METADATA: dict[str, Metadata] = {
    ".png": {}, ".pdf": {"CreationDate": None}, ".svg": {"Date": None},
}  # fmt: skip
"""Formats to look at, for LaTeX and to be edited, each without the date."""


def controller_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour for each controller; those that ship have the same one in every figure."""
    unknown = sorted({*names} - {*_CONTROLLERS})
    return _CONTROLLERS | dict(zip(unknown, cycle(_OTHER_CONTROLLERS), strict=False))


def plain(name: str) -> str:
    """A name from outside, such as a path's file name, as text that a figure can show.

    Matplotlib would read ``$`` as mathematics and leave out a label that begins with ``_``.
    """
    readable = " ".join(name.encode("utf-8", "replace").decode("utf-8").split())
    if len(readable) > _LONGEST_NAME:
        readable = f"{readable[:_LONGEST_NAME]}..."
    escaped = readable.replace("$", r"\$")
    return f" {escaped}" if escaped.startswith("_") else escaped


def save_figure(figure: Figure, file: Path) -> None:
    """Write a figure as PNG, and as PDF and SVG beside it."""
    for suffix, metadata in _METADATA.items():
        with replacing(file.with_suffix(suffix)) as draft:
            _write(figure, draft, suffix.removeprefix("."), metadata)
        figure.set_layout_engine("none")  # What was found for the first format holds for all.


def svg_element(figure: Figure) -> str:
    """A figure as the element ``<svg>`` of a page."""
    text = io.StringIO()
    _write(figure, text, "svg", _METADATA[".svg"])
    whole = text.getvalue()
    return whole[whole.index("<svg") :]


def _write(figure: Figure, file: Path | io.StringIO, form: str, metadata: Metadata) -> None:
    from matplotlib import rc_context  # noqa: PLC0415 - costs 0.7 s
    from matplotlib.backend_bases import get_registered_canvas_class  # noqa: PLC0415

    # TrueType is what publishers ask for; the salt gives equal runs equal files.
    settings = rc_context({"pdf.fonttype": 42, "svg.hashsalt": "ccr-host"})
    with settings, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        # Figure.savefig would draw once more to find the layout, which any drawing does.
        figure.set_dpi(_DPI)
        canvas = get_registered_canvas_class(form)(figure)
        getattr(canvas, f"print_{form}")(file, metadata=metadata)
