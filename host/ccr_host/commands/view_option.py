"""The option ``--view [HOST:PORT]``: the one option whose value may be left out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

import typer

from ccr_host.view.address import DEFAULT_ADDRESS

ViewOption = Annotated[
    str | None,
    typer.Option(
        "--view",
        metavar="[HOST:PORT]",
        help=f"Show the run in the browser while it happens; {DEFAULT_ADDRESS} by default.",
    ),
]


def with_default_address(words: Sequence[str]) -> list[str]:
    """Give ``--view`` its default where no HOST:PORT follows it."""
    return [
        f"--view={DEFAULT_ADDRESS}"
        if word == "--view" and not _is_like_an_address(following)
        else word
        for word, following in pairwise([*words, ""])
    ]


def _is_like_an_address(word: str) -> bool:
    return word.startswith("[") or (":" in word and word.rpartition(":")[2].isdigit())
