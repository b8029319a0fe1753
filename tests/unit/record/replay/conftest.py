from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def short_path(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Three seconds well inside the workspace."""
    file = tmp_path_factory.mktemp("path") / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n3,10,35\n")
    return str(file)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "run"
    made.mkdir()
    return made
