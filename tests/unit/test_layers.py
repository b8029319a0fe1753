"""The layers of docs/architecture.md: a package imports only what lies below it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import ccr_host

HOUSE = Path(ccr_host.__file__).parent
LAYERS = (
    ("core",),
    ("description",),
    ("robot",),
    ("link", "tracking"),
    ("control", "sim"),
    ("run",),
    ("record",),
    ("tools", "view"),
    ("commands",),
    ("cli", "__init__"),
)
LAYER = {package: layer for layer, packages in enumerate(LAYERS) for package in packages}


def imported(source: str) -> Iterator[str]:
    """Our modules that a source imports, wherever in it, by their full names."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "relative imports hide the layer"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "ccr_host")


def upward(package: str, source: str) -> list[str]:
    """What a module of this package imports from the other half of its own layer or from above."""
    allowed = {name for name, layer in LAYER.items() if layer < LAYER[package]} | {package}
    return [name for name in imported(source) if f"{name}.".split(".")[1] not in allowed]


def test_every_package_has_a_layer() -> None:
    there = {path.stem for path in HOUSE.iterdir() if path.suffix == ".py" or is_package(path)}
    assert there == set(LAYER)


def is_package(path: Path) -> bool:
    return (path / "__init__.py").is_file()


@pytest.mark.parametrize("package", LAYER)
def test_imports_only_go_down(package: str) -> None:
    files = [HOUSE / f"{package}.py", *(HOUSE / package).rglob("*.py")]
    found = {
        str(file.relative_to(HOUSE)): names
        for file in files
        if file.is_file() and (names := upward(package, file.read_text(encoding="utf-8")))
    }
    assert not found


@pytest.mark.parametrize(
    "source",
    [
        "from ccr_host.run.loop import PathRun",
        "import ccr_host.run",
        "from ccr_host import __version__",
        "def late():\n    from ccr_host.tracking import tracker",
    ],
)
def test_an_import_that_does_not_go_down_is_noticed(source: str) -> None:
    assert upward("link", source)
