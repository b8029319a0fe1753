"""What a control step costs apart from the controller, and what the loop drags in."""

import subprocess
import sys

import pytest

from bench.step_calls import count

LOADED = """
import sys
import ccr_host.run.loop
print("mujoco" in sys.modules, sum(name.split(".")[0] == "ccr_host" for name in sys.modules))
"""


@pytest.mark.long
def test_a_step_makes_at_most_sixty_calls_outside_the_controller():
    counter = count(rate_hz=20.0)
    assert counter.calls.total() / counter.steps <= 60


@pytest.mark.long
def test_a_further_picture_of_a_period_costs_a_step_at_most_ten_calls_of_ours():
    counter = count(rate_hz=5.0)
    ours = sum(n for code, n in counter.calls.items() if "ccr_host" in code.co_filename)
    assert ours / counter.steps <= 60 + 3 * 10


def test_the_loop_loads_at_most_forty_of_our_modules_and_no_simulation():
    told = subprocess.run(
        [sys.executable, "-c", LOADED], capture_output=True, check=True, text=True
    )
    has_mujoco, modules = told.stdout.split()
    assert has_mujoco == "False"
    assert int(modules) <= 40
