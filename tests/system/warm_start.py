"""Starts the program in a process that has imported its modules already.

Hundreds of tests start it, and its imports take about a second each time. A process of
multiprocessing's fork server has them; all else, arguments, folder, environment, streams, signals
and exit status, is as after a start from a shell. Tests of the start itself start `COMMAND`.

Figures are composed, but drawn only on request, as this takes half of a short run's time. Otherwise
their files are there and empty.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import re
import signal
import sys
import weakref
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from io import StringIO
from multiprocessing import reduction
from multiprocessing.process import BaseProcess
from pathlib import Path
from subprocess import TimeoutExpired
from tempfile import TemporaryFile
from typing import Any

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
        "distributed",
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
        "matplotlib.backends.backend_agg",
        "matplotlib.backends.backend_pdf",
        "matplotlib.backends.backend_svg",
    ]
)

Prepared = Callable[[], object]


def as_usual() -> None:
    """Nothing differs."""


def with_streams(streams: str) -> None:
    """Redirect this process's standard streams as a shell does.

    Args:
        streams: any of ``> FILE``, ``2> FILE``, ``< FILE``, ``>&-``, ``2>&-`` and ``<&-``.
    """
    for number, sign, file in re.findall(r"(2?)([<>])(&-| \S+)", streams):
        descriptor = 0 if sign == "<" else int(number or 1)
        if file == "&-":
            os.close(descriptor)
            setattr(sys, _STREAMS[descriptor], None)  # as the interpreter does at its start
        else:
            opened = os.open(file.strip(), os.O_RDONLY if sign == "<" else os.O_WRONLY)
            os.dup2(opened, descriptor)
            os.close(opened)
            if descriptor == 0:
                sys.stdin = os.fdopen(0, closefd=False)


_STREAMS = ("stdin", "stdout", "stderr")


class Program:
    """`ccr-host` at work, with the part of `subprocess.Popen` that tests use.

    Args:
        words: after the program's name.
        folder: to run in.
        output: descriptors of standard output and standard error, or of the terminal that all its
            streams are; closed here.
        environment: beside that of the tests.
        drawn: whether its figures are drawn.
        prepared: called in its process before it starts, as what shell and computer differ in.
    """

    def __init__(
        self,
        words: Sequence[str],
        folder: Path,
        output: Sequence[int],
        *,
        environment: Mapping[str, str] | None = None,
        drawn: bool = False,
        prepared: Prepared = as_usual,
    ) -> None:
        self.args = ["ccr-host", *words]
        begun, begins = os.pipe()
        self._process = _SERVER.Process(
            target=_program,
            args=(words, str(folder), [_Passed(one) for one in output], _Passed(begins)),
            kwargs={
                "environment": os.environ | (environment or {}),
                "drawn": drawn,
                "prepared": prepared,
            },
        )
        self._process.start()
        weakref.finalize(self, _end, self._process)  # what a test that failed has left
        for descriptor in (*output, begins):
            os.close(descriptor)
        # Until then it holds what the server listens on, which is not the program's.
        os.read(begun, 1)
        os.close(begun)
        assert self._process.pid is not None
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        """Negative: the number of the signal that killed it."""
        return self._process.exitcode

    def poll(self) -> int | None:
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self.returncode is None:
            raise TimeoutExpired(self.args, timeout or 0.0)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            with suppress(ProcessLookupError):  # its status is not known yet
                os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class PipedProgram(Program):
    """One whose standard output and standard error are read meanwhile; see `Program`."""

    def __init__(
        self,
        words: Sequence[str],
        folder: Path,
        *,
        drawn: bool = False,
        prepared: Prepared = as_usual,
    ) -> None:
        pipes = [os.pipe(), os.pipe()]
        self.stdout, self.stderr = (os.fdopen(reader, encoding="utf-8") for reader, _ in pipes)
        writers = [writer for _, writer in pipes]
        super().__init__(words, folder, writers, drawn=drawn, prepared=prepared)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """The rest of both, once it has ended.

        Raises:
            TimeoutExpired: it was killed.
        """
        with ThreadPoolExecutor(2) as readers:
            rests = [readers.submit(stream.read) for stream in (self.stdout, self.stderr)]
            try:
                self.wait(timeout)
            except TimeoutExpired:
                self.kill()
                raise
            out, err = (rest.result() for rest in rests)
            return out, err


def run_program(
    words: Sequence[str], folder: Path, timeout_s: float, *, drawn: bool
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
    with TemporaryFile("w+", encoding="utf-8") as out, TemporaryFile("w+", encoding="utf-8") as err:
        output = [os.dup(file.fileno()) for file in (out, err)]
        program = Program(words, folder, output, drawn=drawn)
        try:
            status = program.wait(timeout_s)
        except TimeoutExpired:
            program.kill()
            program.wait()
            raise
        out.seek(0)
        err.seek(0)
        return status, out.read(), err.read()


def _end(process: BaseProcess) -> None:
    if process.is_alive():
        process.kill()


class _Passed:
    """A descriptor that becomes one of the process that is started."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor

    def __reduce__(self) -> tuple[Any, ...]:
        return _received, (reduction.DupFd(self.descriptor),)


def _received(duplicate: Any) -> int:
    return duplicate.detach()


def _program(
    words: Sequence[str],
    folder: str,
    output: Sequence[int],
    begins: int,
    *,
    environment: Mapping[str, str],
    drawn: bool,
    prepared: Prepared,
) -> None:
    os.close(begins)
    if len(output) == 1:
        os.login_tty(output[0])
        sys.stdin = os.fdopen(0, closefd=False)
    else:
        for descriptor, stream in enumerate(output, start=1):
            os.dup2(stream, descriptor)
            os.close(stream)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    sys.argv = ["ccr-host", *words]
    if not drawn:
        FigureCanvasAgg.print_png = FigureCanvasPdf.print_pdf = FigureCanvasSVG.print_svg = _empty
    prepared()
    try:
        main()
    finally:
        atexit._run_exitfuncs()


def _empty(canvas: FigureCanvasBase, file: Path | StringIO, metadata: Mapping[str, None]) -> None:
    if isinstance(file, StringIO):
        file.write("<svg></svg>")
    else:
        file.touch()
