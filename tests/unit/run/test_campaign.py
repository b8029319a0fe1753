"""Several runs, one after the other on a real robot."""

import socket

from ccr_host.core.errors import DeviceError
from ccr_host.run.campaign import execute_all
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import RunResult


def test_on_a_real_robot_nothing_is_begun_after_a_fault() -> None:
    with socket.socket() as silent:  # bound, so that nothing else listens there
        silent.bind(("127.0.0.1", 0))
        device = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        runs = [RunOptions("8shape", name, device=device) for name in ("open-loop", "mpc")]
        ((index, outcome),) = execute_all(runs)
    assert index == 0
    assert isinstance(outcome, RunResult)
    assert isinstance(outcome.failure, DeviceError)
