"""Compiles the firmware's core for this machine."""

import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).resolve().parents[3] / "firmware"
TESTS = FIRMWARE / "test"
CORE = FIRMWARE / "lib" / "core"
INCLUDES = [f"-I{CORE}", f"-I{FIRMWARE / 'lib' / 'protocol'}"]
STRICT = ["-std=c++14", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
TOOLS = {"g++": "g++", "clang++": "clang libclang-rt-14-dev"}
"""Compilers and the apt packages they come in."""

Build = Callable[..., Path]


def run(*command: str | Path) -> str:
    """Output of a program; the test fails if the program does."""
    result = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, f"{' '.join(map(str, command))}\n{result.stdout}{result.stderr}"
    return result.stdout + result.stderr


def core_sources() -> list[Path]:
    """All of the core."""
    return sorted(CORE.glob("*.cpp"))


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Compiles each source separately and links them, and what is compiled, into a program."""

    def _build(
        compiler: str,
        flags: Sequence[str],
        sources: Sequence[Path],
        unoptimised: Sequence[Path] = (),
    ) -> Path:
        if shutil.which(compiler) is None:
            pytest.fail(f"there is no {compiler}: apt-get install -y {TOOLS[compiler]}")
        folder = tmp_path_factory.mktemp("native_core")

        def compile_one(source: Path) -> Path:
            if source.suffix == ".o":
                return source
            target = folder / f"{source.stem}.o"
            level = ["-O0"] if source in unoptimised else []
            run(compiler, *STRICT, *flags, *level, *INCLUDES, "-c", source, "-o", target)
            return target

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            objects = list(pool.map(compile_one, [*sources, *unoptimised]))
        program = folder / "program"
        run(compiler, *flags, *objects, "-o", program)
        return program

    return _build
