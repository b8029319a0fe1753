"""The conda recipe says what pyproject.toml says."""

import re
import tomllib
from pathlib import Path

from ccr_host.core import __version__

ROOT = Path(__file__).parents[2]


def test_the_conda_recipe_has_the_requirements_version_and_command_of_the_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    run = recipe.partition("  run:\n")[2].partition("\n\n")[0]
    asked = [line.removeprefix("    - ").replace(" ", "") for line in run.splitlines()]
    assert asked == [f"python{project['requires-python']}", *project["dependencies"]]
    assert re.findall(r'^  version: "(.*)"$', recipe, re.M) == [__version__]
    (command,) = project["scripts"].items()
    assert f"- {' = '.join(command)}\n" in recipe
