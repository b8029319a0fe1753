"""docs/robot-description.md matches the code."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from ccr_host.description import schema, simulation
from ccr_host.description.source import shipped_descriptions

DOCS = Path(__file__).parents[3] / "docs"

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


def test_committed_reference_is_current(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("describe_keys").reference()
    assert (DOCS / "robot-description.md").read_text(encoding="utf-8") == page, (
        "renew it: python docs/describe_keys.py > docs/robot-description.md"
    )


@pytest.mark.parametrize("section", SECTIONS)
def test_every_key_has_a_meaning(section):
    assert [key for key, field in section.model_fields.items() if not field.description] == []


@pytest.mark.parametrize("name", shipped_descriptions())
def test_shipped_description_loads_and_carries_its_name(name):
    assert schema.load(name).name == name


def test_what_a_description_leaves_out_is_the_ideal_robot():
    """One truth for theory, the defaults of the keys, except for the damping of real robots."""
    ideal, usual = schema.load("ideal"), schema.Description().twin
    damped = ideal.twin.model_copy(update={"joint_damping": usual.joint_damping})
    assert ideal.model_copy(update={"twin": damped}) == schema.Description(name="ideal")


def test_a_named_robot_is_simulated_with_its_faults_unless_it_is_the_ideal_one():
    ideal = schema.load("ideal").twin
    for name in shipped_descriptions():
        assert (schema.load(name).twin == ideal) == (name == "ideal")
    assert schema.load() == schema.load("default")


def test_the_dirty_robots_segments_yield_as_one_kind_of_leaf_does():
    """Its bending stiffness fixes a printed leaf, 8 mm wide and 0.8 mm thick; so all the others."""
    modulus_pa, poisson = 1.7e9, 0.4
    width_m, length_m, thickness_m, bow_m = 8e-3, 5e-3, 0.8e-3, 1e-3
    twin = schema.load("dirty").twin
    in_series = np.array(twin.flexures)
    bending = modulus_pa * width_m * thickness_m**3 / 12 / length_m
    twist = modulus_pa / (1 + poisson) / 2 * width_m * thickness_m**3 / 3
    twist *= (1 - 0.63 * thickness_m / width_m) / length_m
    warping = modulus_pa * (width_m * thickness_m) ** 3 / 144
    half_decay = np.sqrt(twist * length_m**3 / warping) / 2
    straight = modulus_pa * width_m * thickness_m / length_m
    bowed = 15 / 8 * bending / bow_m**2
    expected = {
        "bending_stiffness_nm_rad": bending,
        "sideways_stiffness_nm_rad": bending * (width_m / thickness_m) ** 2,
        "torsion_stiffness_nm_rad": twist / (1 - np.tanh(half_decay) / half_decay),
        "axial_stiffness_n_m": straight * bowed / (straight + bowed),
    }
    for key, one in expected.items():
        assert getattr(twin, key) == pytest.approx(one / in_series, rel=0.15)
