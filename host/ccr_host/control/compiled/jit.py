"""How functions of this package are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile on first use; a division by zero gives inf or NaN, as in NumPy."""
    return cast(Function, numba.njit(error_model="numpy")(function))


def compiled_on_disk(function: Function) -> Function:
    """The same, kept from one process to the next where a folder can be written."""
    try:
        return cast(Function, numba.njit(error_model="numpy", cache=True)(function))
    except RuntimeError:
        return compiled(function)


def callable_when_compiled(function: Function) -> Function:
    """Let compiled functions call a plain one of the default path; it stays plain itself."""
    register_jitable(error_model="numpy")(function)
    return function
