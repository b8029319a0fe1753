import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.robot.arc import arc_derivatives
from ccr_host.tracking.uneven_arc import UnevenArc, chord
from tests.unit.tracking.registration.hinged_chain import (
    DISK_N,
    LENGTH_MM,
    MARKER_N,
    OFFSET_MM,
    RADIUS_MM,
    STIFFNESS_NM,
    HingedChain,
)

BENDINGS = np.linspace(-2.0, 2.0, 9)
FREE = np.zeros(9)
LOAD = 1e-3 * (2 * MARKER_N + 5 * DISK_N) * LENGTH_MM / STIFFNESS_NM


def test_without_load_it_is_the_unit_arc():
    unit, moment = chord(BENDINGS, UnevenArc(0.0, 0.0, FREE, 0.0))
    np.testing.assert_allclose(unit, arc_derivatives(BENDINGS)[0], atol=4e-4)
    np.testing.assert_allclose(moment, BENDINGS, atol=1e-9)


@pytest.mark.parametrize("gravity", [-1j, 1j, 1.0 + 0j], ids=["below", "above", "along"])
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("taper", [-0.3, 0.0, 0.3])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_it_is_the_limit_of_a_chain_of_hinges(gravity, friction, taper, way):
    """In direction and length of the chord; the even arc is off by degrees."""
    chain = HingedChain(friction, taper, hinges=12, gravity=gravity)
    bendings = np.array([-1.8, -0.9, 0.9, 1.8])
    sag = LENGTH_MM / (8 * 12**2 * RADIUS_MM)
    load = LOAD * (gravity.real - 1j * gravity.imag)
    unit, _ = chord(bendings, UnevenArc(load, taper, np.full(4, friction * way), sag))
    for bending, found in zip(bendings, unit, strict=True):
        first, second, _ = chain.markers_mm(bending, way)
        _, minus_y, z = second - first
        seen = complex(-minus_y, z) - 1j * OFFSET_MM * (np.exp(1j * bending) - 1)
        assert abs(np.angle(seen / found)) < np.radians(0.4)
        hinged = 1 - bending**2 / (12 * 12**2)
        assert abs(seen) == pytest.approx(LENGTH_MM * hinged * abs(found), abs=0.15)


@given(
    st.floats(-2.5, 2.5),
    st.floats(-0.5, 0.5),
    st.floats(-0.3, 0.3),
    st.floats(0.0, 0.4),
    st.floats(0.0, 0.05),
)
def test_turned_over_it_bends_the_other_way(bending, load, taper, friction, sag):
    arc = UnevenArc(0.2 + 1j * load, taper, np.array([friction]), sag)
    over = arc._replace(load=0.2 - 1j * load, friction=-arc.friction)
    one, other = chord(np.array([bending]), arc)[0], chord(np.array([-bending]), over)[0]
    assert abs(one[0] - other[0].conjugate()) < 1e-9
