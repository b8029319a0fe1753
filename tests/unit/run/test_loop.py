"""The control loop on emulated board and twin, with controllers and trackers that misbehave."""

from dataclasses import replace

import numpy as np
import pytest

from ccr_host.control.base import Command, Outcome
from ccr_host.core.errors import CodeError, TrackerError
from ccr_host.link.messages import State
from ccr_host.robot.reference import Reference
from ccr_host.run.loop import PathRun
from ccr_host.run.observer import Observers, StepRecord
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RunOptions
from ccr_host.run.rig import Rig
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.tracker import Sample

STEPS = 8
SILENT = Observers()
STRAIGHT_MM = np.array([(0.0, 0.0, 0.0), (0.0, -58.5, 0.0), (0.0, -102.0, 0.0)])
"""Markers of a straight robot."""
OPTIONS = RunOptions(path="8shape", overrides=("control.coast_s=2", "control.hold_s=3"))


def reference(steps: int = STEPS, period_s: float = 1.0) -> Reference:
    return Reference(
        name="still",
        period_s=period_s,
        time_s=np.arange(steps) * period_s,
        target_mm=np.tile([0.0, -100.0, 20.0], (steps, 1)),
        q_rad=np.zeros((steps, 2)),
        unavoidable_mm=np.zeros(steps),
    )


class Counting:
    """Asks for another angle at each step, so that a held command can be told."""

    name = "counting"

    def __init__(self, before_answer=lambda step: None) -> None:
        self.before_answer = before_answer
        self.observations = []

    def start(self, reference: Reference) -> Command:
        return self.command(0)

    def step(self, observation) -> Command:
        self.observations.append(observation)
        self.before_answer(observation.step)
        return self.command(observation.step)

    @staticmethod
    def command(step: int) -> Command:
        return Command(np.array([0.01, 0.02]) * step, np.zeros((0, 3)), Outcome.SOLVED)


class LostAfter:
    """A tracker whose markers vanish."""

    name = "lost:"

    def __init__(self, rig: Rig, last_us: int) -> None:
        self.rig = rig
        self.last_us = last_us

    def arrived(self) -> list[Sample]:
        now_us = self.rig.clock.now_us()
        return [Sample(now_us, STRAIGHT_MM)] if now_us <= self.last_us else []

    def trouble(self) -> str:
        return ""


@pytest.fixture
def rig():
    with open_rig(OPTIONS, OPTIONS.description(), SILENT) as opened:
        yield opened


def follow(rig: Rig, controller, path: Reference, on_step=lambda *_: None) -> list[StepRecord]:
    description = OPTIONS.description()
    markers = MarkerCheck(description)
    run = PathRun(rig, controller, path, description, SILENT, on_step, markers=markers)
    return run.execute()


def test_the_command_of_a_step_is_on_the_servos_at_its_end(rig: Rig) -> None:
    reported = []

    def look(step: int, steps: int, record: StepRecord) -> None:
        reported.append(rig.client.telemetry.report.setpoint_cdeg)

    records = follow(rig, Counting(), reference(), look)
    wanted = [tuple(np.round(np.degrees(record.q_rad) * 100)) for record in records]
    assert reported == wanted
    assert len(records) == STEPS


def test_a_controller_sees_the_measurement_made_at_the_end_of_the_step_before(rig: Rig) -> None:
    controller = Counting()
    records = follow(rig, controller, reference())
    for observation, before in zip(controller.observations, records, strict=False):
        assert observation.step == before.step + 1
        assert np.array_equal(observation.tip_mm, before.measured_mm)
        assert 40_000 <= observation.tip_age_us <= 90_000, "latency plus at most a camera period"
        assert observation.q_rad == pytest.approx(before.q_rad, abs=1e-4)


def test_a_controller_sees_every_picture_of_the_camera_once(rig: Rig) -> None:
    controller = Counting()
    follow(rig, controller, reference())
    seen_us = []
    for observation in controller.observations:
        ages_us = [*(picture.age_us for picture in observation.earlier), observation.tip_age_us]
        assert len(ages_us) == 20
        seen_us += [observation.time_us - age_us for age_us in ages_us]
    assert set(np.diff(seen_us)) == {50_000}
    newest_mm = controller.observations[-1].tip_mm
    assert not np.array_equal(controller.observations[-1].earlier[-1].tip_mm, newest_mm)


def test_a_picture_that_cannot_be_the_robots_is_kept_from_the_controller(rig: Rig) -> None:
    class Flickering(LostAfter):
        def arrived(self) -> list[Sample]:
            return [
                Sample(one.exposed_us, one.markers_mm * (3.0 if one.exposed_us % 7 == 0 else 1.0))
                for one in rig.tracker.arrived()
            ]

    controller = Counting()
    follow(replace(rig, tracker=Flickering(rig, 0)), controller, reference())
    tips_mm = [
        picture.tip_mm for seen in controller.observations for picture in [*seen.earlier, seen]
    ]
    assert 90 < len(tips_mm) < 20 * (STEPS - 1)
    assert np.abs(np.array(tips_mm) - tips_mm[0]).max() < 40


def test_a_late_command_is_replaced_by_the_last_one_and_counted(rig: Rig) -> None:
    def dawdle(step: int) -> None:
        if step == 3:
            rig.clock.sleep_until_us(rig.clock.now_us() + 600_000)

    records = follow(rig, Counting(dawdle), reference())
    assert [record.step for record in records if record.late] == [3]
    assert np.array_equal(records[3].q_rad, records[2].q_rad)
    assert records[3].outcome is Outcome.HELD
    assert records[4].q_rad == pytest.approx([0.04, 0.08]), "the run goes on"


def test_without_markers_the_controller_coasts_then_the_pose_is_held_then_the_run_ends(
    rig: Rig,
) -> None:
    controller = Counting()
    seen: list[StepRecord] = []
    lost_at_us = rig.clock.now_us() + 6_000_000
    blind = replace(rig, tracker=LostAfter(rig, lost_at_us))
    with pytest.raises(TrackerError, match="no markers"):
        follow(blind, controller, reference(20), lambda *words: seen.append(words[2]))
    lost_s = (rig.clock.now_us() - lost_at_us) * 1e-6
    assert 2 + 3 < lost_s <= 2 + 3 + 1, "seen at the next step"
    outcomes = [record.outcome for record in seen if record.measured_mm is None]
    assert Outcome.HELD in outcomes
    held = [record.q_rad for record in seen if record.outcome is Outcome.HELD]
    assert all(np.array_equal(q, held[0]) for q in held)
    coasting = [
        observation for observation in controller.observations if observation.tip_mm is None
    ]
    assert 1 <= len(coasting) <= 3


class Exchanged:
    """A tracker that takes two markers for each other from some time on."""

    name = "exchanged:"

    def __init__(self, rig: Rig, order: tuple[int, ...], from_us: int) -> None:
        self.rig, self.order, self.from_us = rig, list(order), from_us

    def arrived(self) -> list[Sample]:
        return [
            Sample(sample.exposed_us, sample.markers_mm[self.order])
            if sample.exposed_us >= self.from_us
            else sample
            for sample in self.rig.tracker.arrived()
        ]

    def trouble(self) -> str:
        return ""


EXCHANGES = {(2, 1, 0): "M1 and M3", (1, 0, 2): "M1 and M2", (0, 2, 1): "M2 and M3"}


@pytest.mark.parametrize("order", EXCHANGES)
def test_exchanged_markers_are_named_before_the_robot_is_armed(rig: Rig, order) -> None:
    wrong = replace(rig, tracker=Exchanged(rig, order, 0))
    with pytest.raises(TrackerError, match=f"markers {EXCHANGES[order]} are exchanged"):
        follow(wrong, Counting(), reference())
    assert rig.client.read_state().state is State.DISARMED
    assert rig.clock.now_us() < 3_000_000


@pytest.mark.long
@pytest.mark.parametrize("period_s", [1.0, 0.05])
@pytest.mark.parametrize("order", EXCHANGES)
def test_markers_exchanged_in_mid_run_end_it_before_anybody_steers_by_them(
    rig: Rig, order, period_s: float
) -> None:
    controller = Counting()
    from_us = rig.clock.now_us() + 6_000_000
    wrong = replace(rig, tracker=Exchanged(rig, order, from_us))
    with pytest.raises(TrackerError, match=f"markers {EXCHANGES[order]} have changed places"):
        follow(wrong, controller, reference(400, period_s))
    tips_mm = [one.tip_mm for one in controller.observations if one.tip_mm is not None]
    assert np.abs(np.diff(tips_mm, axis=0)).max() < 5
    assert rig.clock.now_us() < from_us + 4_000_000


def test_a_robot_whose_markers_were_never_seen_is_not_armed(rig: Rig) -> None:
    class Blind:
        name = "blind:"

        def arrived(self) -> list[Sample]:
            return []

        def trouble(self) -> str:
            return ""

    with pytest.raises(TrackerError, match="no markers from blind:"):
        follow(replace(rig, tracker=Blind()), Counting(), reference())
    assert rig.client.telemetry.report.state is State.DISARMED


def test_whatever_ends_a_run_the_robot_is_disarmed_at_the_pins() -> None:
    with (
        pytest.raises(CodeError, match="boom"),
        open_rig(OPTIONS, OPTIONS.description(), SILENT) as rig,
    ):

        def explode(step: int) -> None:
            raise RuntimeError("boom")

        follow(rig, Counting(explode), reference())
    report = rig.client.telemetry.report
    assert report.state is State.DISARMED
    assert report.pulse_half_us == (0, 0)


@pytest.mark.long
@pytest.mark.parametrize("period_s", [3.0, 30.0])
def test_targets_stay_fresh_between_slow_steps(rig: Rig, period_s: float) -> None:
    states = set()

    def look(step: int, steps: int, record: StepRecord) -> None:
        states.add(rig.client.telemetry.report.state)

    follow(rig, Counting(), reference(4, period_s), look)
    assert states == {State.ACTIVE}


@pytest.mark.long
@pytest.mark.parametrize(
    ("period_s", "validity_ms"),
    [(0.02, 200), (0.05, 200), (0.2, 500), (1.0, 2500), (30.0, 10_000)],
)
def test_a_target_outlives_its_step_by_little_so_that_a_dead_host_is_noticed(
    rig: Rig, period_s: float, validity_ms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = []
    set_target = rig.client.set_target

    def noted(q_rad, *, ramp_ms: int, validity_ms: int) -> None:
        sent.append(validity_ms)
        set_target(q_rad, ramp_ms=ramp_ms, validity_ms=validity_ms)

    monkeypatch.setattr(rig.client, "set_target", noted)
    follow(rig, Counting(), reference(2, period_s))
    assert set(sent) == {validity_ms}
