"""What a control step costs apart from the controller, and what the loop drags in."""

import subprocess
import sys

from bench.step_calls import count

LOADED = """
import sys
import ccr_host.run.loop
print("mujoco" in sys.modules, sum(name.split(".")[0] == "ccr_host" for name in sys.modules))
"""


def test_a_step_makes_at_most_sixty_calls_of_ours_and_ten_for_each_further_picture():
    counter = count(rate_hz=5.0)
    ours = sum(n for code, n in counter.calls.items() if "ccr_host" in code.co_filename)
    assert ours / counter.steps <= 60 + 10 * (20 / 5 - 1)


def test_the_loop_loads_few_of_our_modules_and_no_simulation():
    told = subprocess.run(
        [sys.executable, "-c", LOADED], capture_output=True, check=True, text=True
    )
    has_mujoco, modules = told.stdout.split()
    assert has_mujoco == "False"
    assert int(modules) <= 41
