"""Runs the doctest cases of the core, which are named by the requirements they show."""

import re
import shutil
from pathlib import Path

import pytest

from tests.firmware.native_core.conftest import (
    CORE,
    FIRMWARE,
    INCLUDES,
    SANITIZERS,
    STRICT,
    TESTS,
    Build,
    core_sources,
    run,
)

SOURCES = sorted((TESTS / "test_core").glob("test_*.cpp"))
FOR_ANY_AXES = TESTS / "test_core" / "test_axes.cpp"
PROPERTIES = TESTS / "test_core" / "test_properties.cpp"
SPEC = FIRMWARE.parent / "protocol" / "spec.toml"
ONLY_ON_THE_PINS = {"TIM-2"}
"""Requirements that the core alone cannot show."""


def test_every_case_passes_and_none_is_left_out(build: Build, doctest_main: Path) -> None:
    fast = "-DDOCTEST_CONFIG_SUPER_FAST_ASSERTS"
    # Optimised cases take three times as long to compile, and run for a second either way.
    flags = ["-O1", "-g1", fast, *SANITIZERS]
    program = build("g++", flags, [doctest_main, *core_sources()], unoptimised=SOURCES)

    report = run(program, "--no-colors")

    cases = re.search(r"test cases: +(\d+) \| +(\d+) passed \| 0 failed \| 0 skipped", report)
    assertions = re.search(r"assertions: +(\d+) ", report)
    written = sum(len(re.findall(r"^TEST_CASE\(", text, re.M)) for text in _texts(SOURCES))
    assert cases is not None, report
    assert assertions is not None, report
    assert int(cases[1]) == int(cases[2]) == written
    assert written >= 75
    assert int(assertions[1]) > 100_000


def test_the_cases_for_any_number_of_axes_pass_with_the_most(
    build: Build, doctest_main: Path
) -> None:
    sources = [doctest_main, FOR_ANY_AXES, *core_sources()]
    program = build("g++", ["-O0", "-DCCR_AXES=12"], sources)
    assert re.search(r"test cases: +8 \| +8 passed", run(program, "--no-colors"))


@pytest.mark.slow
@pytest.mark.parametrize("axes", [1, 4, 6, 12])
def test_the_cases_and_properties_hold_with_sanitizers_for_any_number_of_axes(
    build: Build, doctest_main: Path, axes: int
) -> None:
    flags = ["-O1", "-g1", f"-DCCR_AXES={axes}", *SANITIZERS]
    sources = [doctest_main, *core_sources()]
    program = build("g++", flags, sources, unoptimised=[FOR_ANY_AXES, PROPERTIES])
    assert re.search(r"test cases: +9 \| +9 passed", run(program, "--no-colors"))


def test_every_requirement_that_the_core_can_show_has_a_case() -> None:
    required = set(re.findall(r'^id = "([A-Z]+-\d+)"', SPEC.read_text(encoding="utf-8"), re.M))
    named = {
        name
        for text in _texts(SOURCES)
        for title in re.findall(r'^TEST_CASE\(\s*"(.*)"', text, re.M)
        for name in re.findall(r"[A-Z]{3}-\d+", title)
    }
    assert len(required) > 35
    assert required - ONLY_ON_THE_PINS == named - ONLY_ON_THE_PINS


@pytest.mark.parametrize("source", core_sources(), ids=lambda source: str(source.name))
def test_the_core_compiles_without_a_standard_library(source: Path) -> None:
    """Compile without a C++ standard library, as for the AVR."""
    compiler = shutil.which("g++")
    assert compiler is not None
    freestanding = ["-ffreestanding", "-nostdinc++", "-fno-exceptions", "-fno-rtti"]
    run(compiler, *STRICT, *freestanding, *INCLUDES, "-fsyntax-only", source)


def test_the_core_uses_no_heap_no_float_no_wide_integer_and_no_header_but_stdint() -> None:
    forbidden = re.compile(r"\b(new|malloc|free|delete|float|double|u?int64_t|long long)\b")
    for path in [*CORE.glob("*.h"), *CORE.glob("*.cpp")]:
        code = re.sub(r"//.*", "", path.read_text(encoding="utf-8"))
        assert set(re.findall(r"#include <(.*)>", code)) <= {"stdint.h", "stddef.h"}, path
        assert not forbidden.search(code), path


def _texts(paths: list[Path]) -> list[str]:
    return [path.read_text(encoding="utf-8") for path in paths]


def test_the_skeleton_of_a_new_board_compiles_and_runs(tmp_path: Path) -> None:
    program = tmp_path / "skeleton"
    sources = [FIRMWARE / "boards" / "skeleton" / "main.cpp", *core_sources()]
    run("g++", *STRICT, "-DCCR_AXES=6", *INCLUDES, *sources, "-o", program)
    run(program)
