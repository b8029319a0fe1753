"""A sample project, and PlatformIO with the core folder that is filled from apt and pip."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
CHECKOUT = HERE.parents[2]
PIO = CHECKOUT / "scripts/platformio-offline/pio"
TIMEOUT_S = 180

collect_ignore = ["sample"]


@pytest.fixture(scope="session")
def core_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("platformio") / "core"


@pytest.fixture
def project(tmp_path):
    """Copy of the sample project with our firmware's test runner, which tests may change."""
    copy = shutil.copytree(HERE / "sample", tmp_path / "sample")
    shutil.copy(CHECKOUT / "firmware/test/test_custom_runner.py", copy / "test")
    return copy


@pytest.fixture
def pio(core_folder):
    """Runs pio in a project."""

    def run(folder, *arguments, **environment):
        return subprocess.run(
            [str(PIO), *arguments],
            cwd=folder,
            env={
                **os.environ,
                "PYTHON": sys.executable,
                "CCR_PLATFORMIO_CORE": str(core_folder),
                **environment,
            },
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )

    return run
