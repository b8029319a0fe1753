import copy
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
PROTOCOL = ROOT / "protocol"
sys.path.insert(0, str(PROTOCOL))

_TREE = tomllib.loads((PROTOCOL / "spec.toml").read_text(encoding="utf-8"))


@pytest.fixture
def tree() -> dict[str, Any]:
    """The spec as parsed TOML, free to be changed."""
    return copy.deepcopy(_TREE)


@pytest.fixture(scope="session")
def vector_document() -> dict[str, Any]:
    document: dict[str, Any] = json.loads((PROTOCOL / "vectors.json").read_text(encoding="utf-8"))
    return document


@pytest.fixture(scope="session")
def vectors(vector_document: dict[str, Any]) -> list[dict[str, Any]]:
    return list(vector_document["vectors"])
