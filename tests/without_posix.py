"""Takes from our code what only POSIX systems have, so that Linux can stand in for Windows.

`python -m tests.without_posix WORD...` is `ccr-host WORD...` without it; `pytest --without-posix`
hides it from tests and the code under test. Libraries keep it: theirs differ by system anyway.
"""

from __future__ import annotations

import builtins
import os
import select
import selectors
import signal
import socket
import stat
import sys
from types import ModuleType
from typing import Any

MODULES = frozenset({
    "crypt", "curses", "fcntl", "grp", "nis", "posix", "pty", "pwd", "readline", "resource",
    "spwd", "syslog", "termios", "tty",
})  # fmt: skip
NAMES = {
    os: """
        chown chroot fchmod fchown fork forkpty getegid geteuid getgid getgroups getloadavg getpgid
        getpgrp getpriority getsid getuid initgroups killpg lchown lockf mkfifo mknod nice openpty
        pathconf posix_spawn pread preadv pwrite pwritev readv sched_getaffinity sched_setaffinity
        sched_yield sendfile set_blocking get_blocking setgid setpgid setpriority setsid setuid
        statvfs sync sysconf tcgetpgrp tcsetpgrp ttyname uname wait wait3 wait4 waitid writev
        O_CLOEXEC O_DIRECTORY O_DSYNC O_NDELAY O_NOCTTY O_NOFOLLOW O_NONBLOCK O_SYNC
        WEXITSTATUS WIFEXITED WIFSIGNALED WNOHANG WTERMSIG
    """,
    signal: """
        SIGALRM SIGBUS SIGCHLD SIGCONT SIGHUP SIGKILL SIGPIPE SIGPROF SIGQUIT SIGSTOP SIGTRAP
        SIGTSTP SIGTTIN SIGTTOU SIGUSR1 SIGUSR2 SIGVTALRM SIGWINCH SIGXCPU SIGXFSZ alarm getitimer
        pause pthread_kill pthread_sigmask setitimer siginterrupt sigpending sigtimedwait sigwait
    """,
    select: "epoll kqueue poll",
    socket: "AF_UNIX SO_REUSEPORT CMSG_LEN",
}
"""What typeshed has for no module of Windows."""


class _WithoutPosix(ModuleType):
    """A module without some of its names."""

    def __init__(self, whole: ModuleType, hidden: frozenset[str]) -> None:
        self.__dict__.update(_whole=whole, _hidden=hidden, __name__=whole.__name__)

    def __getattr__(self, name: str) -> Any:
        if name in self._hidden:
            raise AttributeError(f"module {self._whole.__name__!r} has no attribute {name!r}")
        return getattr(self._whole, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._whole, name, value)

    def __delattr__(self, name: str) -> None:
        delattr(self._whole, name)


def hide() -> None:
    """Hide the POSIX modules and names for the rest of this process."""
    real_import = builtins.__import__
    proxies = {
        module.__name__: _WithoutPosix(module, frozenset(names.split()))
        for module, names in NAMES.items()
    }

    def without_posix(
        name: str, namespace: dict[str, Any] | None = None, *rest: Any, **options: Any
    ) -> Any:
        importer = (namespace or {}).get("__name__", "")
        if importer.partition(".")[0] in {"ccr_host", "tests"}:
            if name in MODULES:
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)
            if name in proxies:
                return proxies[name]
        return real_import(name, namespace, *rest, **options)

    builtins.__import__ = without_posix
    selectors.SelectSelector._select = _select_sockets
    selectors.DefaultSelector = selectors.SelectSelector


def _select_sockets(_: object, readers: Any, writers: Any, *rest: Any) -> Any:
    """Windows selects sockets only."""
    for descriptor in (*readers, *writers):
        if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
            raise OSError(10038, "an operation was attempted on something that is not a socket")
    return select.select(readers, writers, *rest)


if __name__ == "__main__":
    hide()
    from ccr_host.cli import main

    sys.argv[0] = "ccr-host"
    main()
