"""docs/robot-description.md matches the code."""

from pathlib import Path

import pytest

from ccr_host.description import schema, simulation
from ccr_host.description.reference_table import reference
from ccr_host.description.source import shipped_descriptions

COMMITTED = Path(__file__).parents[3] / "docs" / "robot-description.md"

SECTIONS = [
    schema.Robot,
    schema.Servo,
    schema.Link,
    schema.Control,
    simulation.Twin,
    simulation.Tracker,
    simulation.PolarisFaults,
    schema.Registration,
    simulation.Push,
]


def test_committed_reference_is_current():
    assert COMMITTED.read_text(encoding="utf-8") == reference(), (
        "renew it: python -m ccr_host.description.reference_table > docs/robot-description.md"
    )


@pytest.mark.parametrize("section", SECTIONS)
def test_every_key_has_a_meaning(section):
    assert [key for key, field in section.model_fields.items() if not field.description] == []


@pytest.mark.parametrize("name", shipped_descriptions())
def test_shipped_description_loads_and_carries_its_name(name):
    assert schema.load(name).name == ("paper" if name == "default" else name)
