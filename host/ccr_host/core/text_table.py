"""Text tables with a header, as spreadsheets and scripts write them.

Commas, semicolons, tabs, bars or spaces separate the columns; quotes, comments and decimal commas
are accepted where they are unambiguous. What a column means is up to the reader of the file.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Generic, NoReturn, TypeVar

from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import lines_of, read_text

Columns = TypeVar("Columns")
Line = tuple[int, str]
"""Line number, and content without comments."""

UNIT = r"(?:[\s_]*[(\[]\s*(\w+)\s*[)\]]|[\s_]+(\w+))?"
"""End of a column's name, a pattern with two groups: ``_s``, `` (ms)``, `` [mm]`` or nothing."""
_COMMENT = re.compile(r"#(.*)|^\s*(?:%|//)(.*)")
_SEPARATORS = ";\t,|"
_NOTHING = re.compile(r"[\s;,|]*|sep=.*", re.IGNORECASE)
"""Blank, or added by spreadsheets: empty cells, and the ``sep=`` line."""
_LONGEST_SHOWN = 20


class TextTable(Generic[Columns]):
    """The rows of a file, and the meaning of its columns.

    ``columns`` tells them from the cells of a header, or says why they are not clear; ``what``, the
    kind of file, and ``header``, as it should be, are for messages.

    Raises:
        ConfigError: states the file, the line, what is wrong with it and the cure.
    """

    def __init__(
        self,
        what: str,
        file: Path,
        header: str,
        at_most_bytes: int,
        columns: Callable[[list[str]], Columns | str],
    ) -> None:
        text, _ = read_text(
            file, what, f"give a text file with the columns {header}", at_most_bytes
        )
        self.name = f"{what} {file}"
        lines, comment = _without_comments(text)
        if "\0" in text or not lines:
            why = "nothing but comments"
            if "\0" in text or not text.strip():
                why = "not text" if text.strip() else "empty"
            raise ConfigError(f"{self.name}: {why}", f"give a header {header} and rows of numbers")
        # The header may be a comment, as numpy.savetxt writes it.
        starts_with = re.split(r"[;\t,| ]", lines[0][1])[0]
        found = _header(comment[1], columns) if comment and is_number(starts_with) else ""
        if isinstance(found, str):
            number, line = lines.pop(0)
            found = _header(line, columns)
            if isinstance(found, str):
                self.refuse(number, found, f"the header is {header}")
        self._separator, self.written, self.columns = found
        """Names of the columns as written, and what they mean."""
        self.lines = lines
        self._decimal_mark = ""

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and cells of each row, one cell for each column.

        Raises:
            ConfigError: a row has another number of cells.
        """
        for line, text in self.lines:
            try:
                cells = _cells(text, self._separator)
            except csv.Error as error:
                self.refuse(line, str(error), "write plain numbers")
            while len(cells) > len(self.written) and not cells[-1]:
                cells.pop()
            if len(cells) != len(self.written):
                self.refuse(
                    line,
                    f"{len(cells)} values for {len(self.written)} columns",
                    "give one value for each column; where commas are decimal, separate them by ;",
                )
            yield line, cells

    def number(self, line: int, column: str, cell: str) -> float:
        """The number in a cell.

        Raises:
            ConfigError: it is not a finite number, or has another decimal mark than those before.
        """
        mark = "".join(sorted(set(cell) & {",", "."}))
        value = _number(cell)
        differs = mark != (self._decimal_mark or mark)
        if not math.isfinite(value) or (mark and differs):
            cure = "give a finite number, nothing else in the column"
            if len(re.findall("[.,]", cell)) > 1:
                cure = "write numbers without marks between the thousands"
            elif mark and differs:
                cure = "give all numbers the same decimal mark"
            self.refuse(line, f"{column} = {shown(cell)}", cure)
        self._decimal_mark = self._decimal_mark or mark
        return value

    def refuse(self, line: int, cause: str, cure: str) -> NoReturn:
        raise ConfigError(f"{self.name}, line {line}: {cause}", cure)


def is_number(text: str) -> bool:
    """Whether a cell is a number, finite or not."""
    return not math.isnan(_number(text))


def shown(text: str) -> str:
    """A cell for messages: shortened, control characters escaped."""
    return repr(text if len(text) <= _LONGEST_SHOWN else text[:_LONGEST_SHOWN] + "...")


def in_ascii(name: str) -> str:
    """A column's name in small letters, with u for micro."""
    return name.lower().replace("µ", "u").replace("μ", "u")


def _without_comments(text: str) -> tuple[list[Line], Line | None]:
    """The lines with content, and the last comment above them."""
    lines: list[Line] = []
    comment: Line | None = None
    for number, whole in enumerate(lines_of(text), 1):
        found = _COMMENT.search(whole)
        content = (whole if found is None else whole[: found.start()]).strip(" ")
        if not _NOTHING.fullmatch(content):
            lines.append((number, content))
        elif found is not None and not lines:
            comment = number, found[1] or found[2] or ""
    return lines, comment


def _header(
    line: str, columns: Callable[[list[str]], Columns | str]
) -> tuple[str | None, list[str], Columns] | str:
    """Separator, None for spaces, names and columns of a header, or why they are not clear."""
    separators = [None, *(separator for separator in _SEPARATORS if separator in line)][::-1]
    reasons = []
    for separator in separators:
        cells = _cells(line, separator)
        while cells and not cells[-1]:
            cells.pop()
        found = columns(cells)
        if not isinstance(found, str):
            return separator, cells, found
        reasons.append(found)
    return reasons[0]


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        cells = line.split()
    else:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [cell.strip().strip("'\"").strip() for cell in cells]


def _number(text: str) -> float:
    """The number that the text stands for; NaN if it is not a number."""
    if "_" in text:  # Python would ignore it
        return math.nan
    try:
        return float(text.replace(",", ".").replace("\N{MINUS SIGN}", "-"))
    except ValueError:
        return math.nan
