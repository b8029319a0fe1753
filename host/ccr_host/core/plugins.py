"""Code from elsewhere: optional dependencies (extras), and classes that users plug in.

A plug-in is a controller, a tracker or a simulated robot (a "plant"). It is named as FILE.py:CLASS
or by an entry point ``ccr_host.controllers``, ``ccr_host.trackers`` or ``ccr_host.plants`` of an
installed package, or passed as an object in Python.
"""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from ccr_host.core.errors import CodeError, ConfigError, blaming
from ccr_host.core.user_file import read_bytes

Kind = Literal["controller", "tracker", "plant"]

FORM = "FILE.py:CLASS"
_IN_FILE = re.compile(r"(.+\.py):(\w+)", re.IGNORECASE)
_GIVEN = "python:"
_MOST_BYTES = 1_000_000


def import_optional(module: str, extra: str, what_for: str) -> ModuleType:
    """Import a package that belongs to an extra.

    Raises:
        ConfigError: it is not installed; the cure is the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ConfigError(
            f"{what_for}: the package {module} is not installed",
            f'pip install "ccr-host[{extra}]"',
        ) from None


class Given(str):
    """The name of a plug-in that was passed as an object in Python; carries that object.

    ``what`` is a class or function to call with the robot description, or a finished object.
    """

    what: object

    def __new__(cls, what: object) -> Given:
        made = super().__new__(cls, _GIVEN + getattr(what, "__name__", type(what).__name__))
        made.what = what
        return made


def plugin_names(kind: Kind) -> list[str]:
    """Entry points of all installed packages, including this one, sorted."""
    return sorted({point.name for point in entry_points(group=f"ccr_host.{kind}s")})


def is_class(name: str) -> bool:
    """Whether a name has the form FILE.py:CLASS or carries an object."""
    return isinstance(name, Given) or _IN_FILE.fullmatch(name) is not None


def is_plugin(kind: Kind, name: str) -> bool:
    """Whether a name is one of `is_class` or an entry point."""
    return is_class(name) or name in plugin_names(kind)


def plugin(kind: Kind, name: str) -> Any:  # noqa: ANN401 - anything that users may write
    """Load the class behind a name of `is_plugin`.

    Raises:
        ConfigError: no such file or class.
        CodeError: the file or package raises an exception when imported.
    """
    if isinstance(name, Given):
        return name.what
    in_file = _IN_FILE.fullmatch(name)
    with blaming(f"{kind} {name}", "correct its file"):
        if not in_file:
            return entry_points(group=f"ccr_host.{kind}s")[name].load()
        file, wanted = Path(in_file[1]), in_file[2]
        source = read_bytes(file, kind, f"give {FORM}", _MOST_BYTES)
        module = _module(file.resolve(), source)
    if not hasattr(module, wanted):
        own = [key for key, value in vars(module).items() if _is_class_of(module, value)]
        there = f"it has {', '.join(own)}" if own else "it has none"
        raise ConfigError(f"{kind} {name}: no class {wanted} in {file}", there)
    return getattr(module, wanted)


def make_plugin(kind: Kind, name: str, methods: Sequence[str], *arguments: object) -> Any:  # noqa: ANN401
    """Instantiate a plug-in; a finished object is returned as it is.

    It must have all ``methods``; ``arguments`` are passed to its constructor.

    Raises:
        ConfigError: see `plugin`.
        CodeError: the constructor fails, or a method is missing.
    """
    maker = plugin(kind, name)
    with blaming(f"{kind} {name}", "correct its class"):
        is_object = not isinstance(maker, type) and all(hasattr(maker, m) for m in methods)
        made = maker if is_object else maker(*arguments)
        for method in methods:
            if not callable(getattr(made, method)):
                raise TypeError(f"{method} must be a method")
    return made


def unknown_plugin(kind: Kind, name: str, known: Sequence[str]) -> ConfigError:
    """The error for a name that is neither built in nor one of `is_plugin`."""
    if name.startswith(_GIVEN):
        cause = f"{kind} {name} was passed as an object in Python, and is unknown elsewhere"
        return ConfigError(cause, f"name its class as {FORM}")
    choice = dict.fromkeys([*known, *plugin_names(kind)])
    return ConfigError(f"unknown {kind} {name}", f"one of {', '.join(choice)} or {FORM}")


class Guard:
    """Reports the first failure of a plug-in and remembers it.

    A plug-in that has failed must not be called again: the clock has to keep running while the
    robot is made safe.
    """

    def __init__(self, who: str, kind: Kind) -> None:
        self._who = who
        self._cure = f"correct the {kind}'s class, or report this if it is not yours"
        self.has_failed = False

    @contextmanager
    def blamed(self, method: str) -> Iterator[None]:
        """Turn any exception of a method into an error that names the method.

        Raises:
            CodeError: for every exception except ours and an interrupt.
        """
        try:
            with blaming(f"{self._who}.{method}", self._cure):
                yield
        except CodeError:
            self.has_failed = True
            raise


@lru_cache
def _module(file: Path, source: bytes) -> ModuleType:
    """Import a file once, and again after changes; it may import modules from its folder."""
    folder = os.fspath(file.parent)
    if folder not in sys.path:
        sys.path.append(folder)
    module = ModuleType(os.fspath(file))
    module.__file__ = module.__name__
    sys.modules[module.__name__] = module  # where dataclasses, for one, look for it
    exec(compile(source, module.__name__, "exec", dont_inherit=True), vars(module))
    return module


def _is_class_of(module: ModuleType, value: object) -> bool:
    return isinstance(value, type) and value.__module__ == module.__name__
