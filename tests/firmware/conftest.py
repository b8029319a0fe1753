"""What all tests of native firmware code are linked with."""

import shutil
import subprocess
from pathlib import Path

import pytest

_MAIN = Path(__file__).parents[2] / "firmware" / "test" / "test_core" / "main.cpp"


@pytest.fixture(scope="session")
def doctest_main(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Doctest itself, compiled once and without sanitizers, with which it takes twice as long."""
    target = tmp_path_factory.mktemp("doctest") / "main.o"
    if shutil.which("g++") is None:
        pytest.fail("there is no g++: apt-get install -y g++ doctest-dev")
    command = ["g++", "-std=c++14", "-c", str(_MAIN), "-o", str(target)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if "doctest/doctest.h" in ended.stderr:
        pytest.fail("there is no doctest/doctest.h: apt-get install -y doctest-dev")
    assert ended.returncode == 0, ended.stderr
    return target
