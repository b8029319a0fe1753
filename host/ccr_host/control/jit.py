"""Compiles functions by numba (extra ``fast``).

Imported only if a robot description requires it.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any, Protocol, TypeVar, cast

import numba
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])
Result_co = TypeVar("Result_co", covariant=True)


def compiled(function: Function) -> Function:
    """Compile on first use; a division by zero gives inf or NaN, as in NumPy."""
    return cast(Function, numba.njit(error_model="numpy")(function))


class Entry(Protocol[Result_co]):
    """A compiled function that Python calls; array arguments are contiguous and writable."""

    def __call__(self, *arguments: object) -> Result_co: ...

    def disable_compile(self) -> None: ...


def compiled_on_disk(function: Callable[..., Result_co]) -> Entry[Result_co]:
    """Compile on first use, cached for other processes if a folder is writable.

    Numba's cache checks only the file of ``function``, but distinguishes functions that enclose
    different values: enclose a ``fingerprint`` of all other code that it uses.
    """
    try:
        return cast(Entry[Result_co], numba.njit(error_model="numpy", cache=True)(function))
    except RuntimeError:
        return cast(Entry[Result_co], compiled(function))


def callable_when_compiled(function: Function) -> Function:
    """Let compiled functions call a plain one of the default path; it stays plain itself."""
    register_jitable(error_model="numpy")(function)
    return function


@contextmanager
def lightly_optimised() -> Iterator[None]:
    """Compile in half the time; code of many small loops, as arrays have, is as fast."""
    config: Any = numba.core.config
    before = config.OPT, config.LOOP_VECTORIZE
    config.OPT, config.LOOP_VECTORIZE = type(config.OPT)(1), 0
    try:
        yield
    finally:
        config.OPT, config.LOOP_VECTORIZE = before


def functions_of(*modules: ModuleType) -> list[Callable[..., Any]]:
    """The functions that modules define themselves."""
    return [
        member
        for module in modules
        for _, member in inspect.getmembers(module, inspect.isfunction)
        if member.__module__ == module.__name__
    ]


def fingerprint(*modules: ModuleType) -> int:
    """A number that depends on the sources of all modules."""
    sources = "".join(map(inspect.getsource, modules))
    return int.from_bytes(hashlib.sha256(sources.encode()).digest()[:7], "big")
