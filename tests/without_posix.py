"""Takes from our code what only POSIX systems have, so that Linux can stand in for Windows.

`python -m tests.without_posix WORD...` is `ccr-host WORD...` without it; `pytest --without-posix`
hides it from tests and the code under test. Libraries keep it: theirs differ by system anyway.
"""

from __future__ import annotations

import builtins
import os
import select
import signal
import sys
from typing import Any

MODULES = frozenset({"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"})


def hide() -> None:
    """Hide the POSIX modules for the rest of this process."""
    real_import = builtins.__import__

    def without_posix(
        name: str, namespace: dict[str, Any] | None = None, *rest: Any, **options: Any
    ) -> Any:
        importer = (namespace or {}).get("__name__", "")
        if name in MODULES and importer.partition(".")[0] in {"ccr_host", "tests"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real_import(name, namespace, *rest, **options)

    builtins.__import__ = without_posix
    for module, name in ((signal, "SIGHUP"), (os, "openpty"), (os, "mkfifo"), (select, "poll")):
        if hasattr(module, name):
            delattr(module, name)


if __name__ == "__main__":
    hide()
    from ccr_host.cli import main

    sys.argv[0] = "ccr-host"
    main()
