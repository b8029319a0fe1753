"""Compiles the firmware's protocol library for this machine and runs its tests."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIBRARY = ROOT / "firmware" / "lib" / "protocol"
NATIVE = Path(__file__).with_name("native")
VECTORS = ROOT / "protocol" / "vectors.json"

STRICT = ["-std=c++14", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow", "-Wpedantic"]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def _run(*command: str | Path) -> str:
    result = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, f"{' '.join(map(str, command))}\n{result.stdout}{result.stderr}"
    return result.stdout


@pytest.mark.parametrize(
    "axes", [1, 2, *(pytest.param(axes, marks=pytest.mark.slow) for axes in (4, 6)), 12]
)
def test_every_vector_and_property_passes(doctest_main: Path, axes: int, tmp_path: Path) -> None:
    report = _report(doctest_main, axes, tmp_path)
    document = json.loads(VECTORS.read_text(encoding="utf-8"))
    vectors = sum(vector["axes"] == axes for vector in document["vectors"])
    source = (NATIVE / "test_protocol.cpp").read_text(encoding="utf-8")
    properties = len(re.findall(r"^TEST_CASE\(", source, re.MULTILINE))
    cases = re.search(r"test cases: +(\d+) \| +(\d+) passed \| 0 failed \| 0 skipped", report)
    assert cases is not None, report
    assert int(cases[1]) == int(cases[2]) == vectors + properties
    assert vectors >= 100
    assert properties >= 5


def _report(doctest_main: Path, axes: int, build: Path) -> str:
    """What the native tests print."""
    _run(sys.executable, NATIVE / "vectors_header.py", VECTORS, build / "vectors.h", str(axes))
    includes = [f"-I{folder}" for folder in (LIBRARY, NATIVE, build)]
    # Without it doctest's assertions take most of the time to compile.
    fast = ("-DDOCTEST_CONFIG_SUPER_FAST_ASSERTS", f"-DCCR_AXES={axes}")
    source, target = NATIVE / "test_protocol.cpp", build / "test_protocol.o"
    _run("g++", *STRICT, *SANITIZERS, *fast, *includes, "-c", source, "-o", target)
    program = build / "tests"
    _run("g++", *SANITIZERS, doctest_main, target, "-o", program)
    return _run(program, "--no-colors")


@pytest.mark.parametrize("header", sorted(LIBRARY.glob("*.h")), ids=lambda header: str(header.name))
def test_each_header_compiles_alone_without_the_standard_library(
    header: Path, tmp_path: Path
) -> None:
    """Compile without a C++ standard library, as for the AVR."""
    source = tmp_path / "alone.cpp"
    source.write_text(f'#include "{header.name}"\n#include "{header.name}"\n')
    freestanding = [
        "-Wsign-conversion",
        "-nostdinc++",
        "-ffreestanding",
        "-fno-exceptions",
        "-fno-rtti",
    ]
    _run("g++", *STRICT, *freestanding, f"-I{LIBRARY}", "-fsyntax-only", source)


def test_the_library_uses_no_heap_and_no_header_but_stdint() -> None:
    for header in LIBRARY.glob("*.h"):
        text = header.read_text(encoding="utf-8")
        assert set(re.findall(r"#include <(.*)>", text)) <= {"stdint.h"}
        assert not re.search(r"\b(new|malloc|free|delete)\b\s*[\w(]", _without_comments(text))


def _without_comments(text: str) -> str:
    return re.sub(r"//.*", "", text)
