"""Every requirement has a test."""

import ast
from pathlib import Path

from tests.requirement_coverage import REQUIREMENTS


def named_requirements() -> set[str]:
    names = set()
    for file in Path(__file__).parent.glob("test_*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr == "requirement"
            ):
                names |= {argument.value for argument in node.args}
    return names


def test_every_requirement_of_the_spec_has_a_test_that_names_it() -> None:
    assert named_requirements() == set(REQUIREMENTS)
