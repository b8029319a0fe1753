"""What the commands print."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

from rich.console import Console

from ccr_host.standard_streams import warn
from ccr_host.user_file import printable

if TYPE_CHECKING:
    from ccr_host.run.folder import ResultFolder

_USUAL_WIDTH = 80


def console(*, on_stderr: bool = False) -> Console:
    """For text that may contain anything, such as the brackets of a file's name."""
    made = Console(stderr=on_stderr, markup=False, highlight=False)
    if made.width < 1:  # COLUMNS=0, as terminals of unknown size have it: nothing would be printed
        made.width = _USUAL_WIDTH
    return made


def tell_kept(screen: Console, folder: ResultFolder, *further_troubles: str) -> None:
    """Where the results are; in one line on standard error, what is missing."""
    if folder.kept:
        where = printable(str(folder.path))
        screen.print(f"kept in {where}/: {', '.join(folder.kept)}", soft_wrap=True)
    troubles = [trouble for trouble in (folder.trouble, *further_troubles) if trouble]
    if troubles:
        warn(f"{folder.path}: {'; '.join(troubles)}")


def print_json(content: dict[str, Any]) -> None:
    """One object on one line of standard output."""
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()
