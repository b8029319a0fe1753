import pytest

from ccr_host.tools.sweep.plan import SweepPlan


@pytest.fixture
def short_path(tmp_path):
    file = tmp_path / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n4,10,35\n")
    return str(file)


@pytest.fixture
def narrow():
    """Limits that make a small static map."""
    return ("servo.angle_min_deg=[-10, -50]", "servo.angle_max_deg=[35, 5]")


@pytest.fixture
def plan(short_path, narrow):
    return SweepPlan(seed=3, paths=(short_path,), overrides=narrow)


@pytest.fixture
def row():
    """A row by the few columns that a test cares for."""

    def make(index=0, rate_hz=1.0, controller="mpc", ratio=1.5, **others):
        return {
            "index": index, "rate_hz": rate_hz, "controller": controller, "path": "8shape",
            "ratio": ratio, "true_mean_error_mm": ratio, "twin_floor_mean_error_mm": 1.0,
            "diverged": False, "within_limits": True, "fault": "", "cpu_s": 2.0,
            "command": f"ccr-host track {index}", **others,
        }  # fmt: skip

    return make
