"""Starts the program in a process that has imported its modules already.

Hundreds of tests start it, and its imports take about a second each time. A process of
multiprocessing's fork server has them; all else, arguments, folder, environment, streams and exit
status, is as after a start from a shell. Tests of the start itself use `CcrHost.start`.

Figures are composed, but drawn only on request, as this takes half of a short run's time. Otherwise
their files are there and empty.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import sys
from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path
from subprocess import TimeoutExpired
from tempfile import TemporaryDirectory

from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG

from ccr_host.cli import main

_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(
    [
        "ccr_host.commands.app",
        "ccr_host.commands.terminal",
        "ccr_host.run.igtl_server",
        "ccr_host.view.feed",
        "fontTools.subset",
        "fontTools.ttLib.tables.otConverters",
        "fontTools.ttLib.tables.otTables",
        "PIL.GifImagePlugin",
        "PIL.JpegImagePlugin",
        "PIL.PpmImagePlugin",
        "rich.progress",
        "ccr_host.run.campaign",
        "ccr_host.record.keep",
        "ccr_host.tools.doctor",
        __name__,
    ]
)


def run_program(
    words: Sequence[str], folder: Path, timeout_s: float, *, drawn: bool = True
) -> tuple[int, str, str]:
    """Run ``ccr-host`` to its end.

    Args:
        words: after the program's name.
        folder: to run in.
        timeout_s: after which it is killed.
        drawn: whether its figures are drawn.

    Returns:
        Exit status, standard output, standard error.

    Raises:
        TimeoutExpired: it was killed.
    """
    with TemporaryDirectory() as kept:
        streams = [str(Path(kept) / name) for name in ("out", "err")]
        process = _SERVER.Process(
            target=_program, args=(words, str(folder), dict(os.environ), streams, drawn)
        )
        process.start()
        process.join(timeout_s)
        if process.is_alive():
            process.kill()
            process.join()
            raise TimeoutExpired(["ccr-host", *words], timeout_s)
        assert process.exitcode is not None
        out, err = (Path(stream).read_text(encoding="utf-8") for stream in streams)
        return process.exitcode, out, err


def _program(
    words: Sequence[str],
    folder: str,
    environment: Mapping[str, str],
    streams: Sequence[str],
    drawn: bool,
) -> None:
    for descriptor, stream in enumerate(streams, start=1):
        os.dup2(os.open(stream, os.O_WRONLY | os.O_CREAT | os.O_APPEND), descriptor)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    sys.argv = ["ccr-host", *words]
    if not drawn:
        FigureCanvasAgg.print_png = FigureCanvasPdf.print_pdf = FigureCanvasSVG.print_svg = _empty
    try:
        main()
    finally:
        atexit._run_exitfuncs()


def _empty(canvas: FigureCanvasBase, file: Path | StringIO, metadata: Mapping[str, None]) -> None:
    if isinstance(file, StringIO):
        file.write("<svg></svg>")
    else:
        file.touch()
