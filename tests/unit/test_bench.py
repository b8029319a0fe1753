"""The programs of bench/ are rarely run, and what they use of the host must still be there."""

import importlib
from pathlib import Path

import pytest

PROGRAMS = sorted(file.stem for file in (Path(__file__).parents[2] / "bench").glob("*.py"))


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_program_of_the_benchmarks_can_be_imported(program: str) -> None:
    importlib.import_module(f"bench.{program}")
