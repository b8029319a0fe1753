"""The doctor's list of the package's extras."""

import re
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from ccr_host.tools.doctor import EXTRAS

PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
FOR_DEVELOPERS = {"test", "dev", "docs", "bench"}


def test_the_doctor_checks_all_extras_of_users_and_no_others() -> None:
    assert EXTRAS.keys() == PROJECT["optional-dependencies"].keys() - FOR_DEVELOPERS


@pytest.mark.long
@pytest.mark.parametrize(("extra", "module"), EXTRAS.items())
def test_an_extra_is_known_by_a_package_that_it_brings(extra: str, module: str) -> None:
    required = PROJECT["optional-dependencies"][extra]
    brought = {re.split(r"[<>=!~\[; ]", name)[0] for name in required}
    assert brought & {name.lower() for name in packages_distributions()[module]}
