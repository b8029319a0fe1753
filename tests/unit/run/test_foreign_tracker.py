"""A user's own tracker that fails."""

import numpy as np
import pytest

from ccr_host.core.errors import CodeError
from ccr_host.core.plugins import Given
from ccr_host.link.messages import State
from ccr_host.record.keep import execute_logged
from ccr_host.record.log import topics
from ccr_host.record.log.reader import RunRecording
from ccr_host.run.options import RunOptions
from ccr_host.tracking.tracker import MarkerFrame, Pose, TrackerHealth

FAILS_AT_US = 1_500_000


class Mine:
    """Sees a robot that stands still, until it does something else."""

    health = TrackerHealth("tracking", tracking=True)

    def __init__(self, deed, method) -> None:
        self.deed = deed
        self.method = method
        self.time_us = 0

    def start(self) -> None:
        self.do("start", None)

    def stop(self) -> None:
        pass

    def advance_to(self, time_us: int) -> None:
        self.time_us = time_us
        self.do("advance_to", None)

    def newest_frame(self):
        at = {"M1": 0.0, "M2": -58.5, "M3": -102.0}
        tools = {name: Pose(np.array([0.0, y, 0.0]), np.eye(4)[0]) for name, y in at.items()}
        nothing = np.zeros((0, 3)), np.zeros(0, dtype=bool)
        return self.do("newest_frame", MarkerFrame(self.time_us, self.time_us, *nothing, tools))

    def do(self, method, answer):
        is_time = self.method == method and (method == "start" or self.time_us > FAILS_AT_US)
        return self.deed(answer) if is_time else answer


def fail(answer):
    raise ZeroDivisionError("my exposure")


@pytest.mark.long
@pytest.mark.parametrize(
    ("method", "deed", "told"),
    [
        ("start", fail, "Mine.start has failed: ZeroDivisionError: my exposure"),
        ("advance_to", fail, "Mine.advance_to has failed: ZeroDivisionError"),
        ("newest_frame", fail, "Mine.newest_frame has failed: ZeroDivisionError"),
        ("newest_frame", lambda frame: np.zeros((3, 3)), "ndarray instead of a MarkerFrame"),
        (
            "newest_frame",
            lambda frame: MarkerFrame(frame.exposed_us, 1, np.zeros(3), np.zeros(1, dtype=bool)),
            r"points_mm and out_of_volume of shapes \(3,\)",
        ),
    ],
)
def test_the_run_ends_disarmed_and_tells_whose_class_has_failed(
    tmp_path, method, deed, told
) -> None:
    overrides = ("control.settle_s=0.1", "link.arm_axis_ms=20")

    def tracker(description):
        return Mine(deed, method)

    options = RunOptions(
        path="8shape", controller="mpc", tracker=Given(tracker), overrides=overrides,
        rate_hz=5.0,
    )  # fmt: skip
    with pytest.raises(CodeError, match=told):
        failure = execute_logged(options, tmp_path, lambda *_: None).failure
        raise failure or AssertionError("the run went on")
    if method == "start":
        return  # nothing was begun
    recording = RunRecording(tmp_path)
    assert recording.end.is_complete
    states = [one.content["state"] for one in recording.messages(topics.STATE)]
    assert states[-1] == State.DISARMED.name.lower()
