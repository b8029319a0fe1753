"""Runs libFuzzer on the core: no bytes, ticks, resets and EEPROM damage break a rule."""

import re
import shutil
from pathlib import Path

import pytest

from tests.firmware.native_core.conftest import SANITIZERS, TESTS, Build, core_sources, run

CORPUS = TESTS / "fuzz" / "corpus"
RUNS = 5_000
MANY_RUNS = 300_000

_MANY_AXES = [pytest.param(axes, marks=pytest.mark.slow) for axes in (6, 12)]


@pytest.fixture(scope="module", params=[2, *_MANY_AXES])
def fuzzer(build: Build, request: pytest.FixtureRequest) -> Path:
    flags = ["-O1", "-g", "-fsanitize=fuzzer", f"-DCCR_AXES={request.param}", *SANITIZERS]
    return build("clang++", flags, [TESTS / "fuzz" / "fuzz_board.cpp", *core_sources()])


def test_the_corpus_and_some_new_inputs_break_no_rule(fuzzer: Path, tmp_path: Path) -> None:
    _fuzz(fuzzer, tmp_path, RUNS)


@pytest.mark.slow
def test_many_new_inputs_break_no_rule(fuzzer: Path, tmp_path: Path) -> None:
    _fuzz(fuzzer, tmp_path, MANY_RUNS)


def _fuzz(fuzzer: Path, tmp_path: Path, runs: int) -> None:
    """Fuzz with a copy of the corpus."""
    corpus = tmp_path / "corpus"
    shutil.copytree(CORPUS, corpus)
    assert len(list(corpus.iterdir())) > 30
    report = run(
        fuzzer,
        f"-runs={runs}",
        "-max_len=512",
        f"-artifact_prefix={tmp_path}/",
        corpus,
    )
    done = re.search(r"Done (\d+) runs", report)
    assert done is not None, report
    assert int(done[1]) >= runs
