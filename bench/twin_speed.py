"""How much faster than real time the simulated robots are; `dirty` has every effect at once too.

    nice -n 19 python -m bench.twin_speed

CPU time of robots whose motors move once and twenty times a second, camera at 20 Hz; medians of
interleaved runs.
"""

from __future__ import annotations

import math
import time
from statistics import median

from ccr_host.description.schema import load
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.robot import TwinRobot

RUNS = 5
SECONDS = 6
PICTURE_US = 50_000
EVERY_EFFECT = (
    *("twin.friction=0.1", "twin.capstan_friction=0.15", "twin.creep_share=0.05"),
    *("twin.stiffness_taper=0.1", "twin.stiffening=0.2", "twin.torsion_stiffness_nm_rad=0.1"),
    *("twin.axial_stiffness_n_m=16000.0", "twin.servo_stall_torque_nm=0.8"),
    *("twin.servo_droop_deg_per_nm=5.0", "twin.servo_backlash_deg=0.5", "twin.servo_lag_ms=10.0"),
)
ROBOTS = {
    **{name: load(name) for name in ("ideal", "paper", "default", "dirty")},
    **{name: load(name) for name in ("single", "two-spatial", "three-spatial")},
    **{
        f"{name}, every effect": load(name, EVERY_EFFECT)
        for name in ("two-spatial", "three-spatial")
    },
}


def main() -> None:
    """Measure and print."""
    print("| robot | 1 Hz | 20 Hz |")
    print("|---|---|---|")
    speeds: dict[tuple[str, int], list[float]] = {}
    for _ in range(RUNS):
        for name, description in ROBOTS.items():
            for rate_hz in (1, 20):
                speeds.setdefault((name, rate_hz), []).append(
                    times_real_time(description.twin, rate_hz)
                )
    for name in ROBOTS:
        print(f"| {name} | {median(speeds[name, 1]):.0f} | {median(speeds[name, 20]):.0f} |")


def times_real_time(twin: Twin, rate_hz: int) -> float:
    """Simulated seconds in a second of CPU time."""
    robot = TwinRobot(twin)
    pictures_per_step = 20 // rate_hz
    before_s = time.process_time()
    for picture in range(SECONDS * 20):
        if picture % pictures_per_step == 0:
            phase = picture / 40
            first_deg, second_deg = 20 + 20 * math.sin(phase), 40 * math.cos(phase)
            angles_deg = [first_deg, second_deg] * len(twin.servo_neutral_us)
            robot.set_pulses_half_us(
                tuple(
                    round(3000 + angle_deg * 2000 / 90)
                    for angle_deg in angles_deg[: len(twin.servo_neutral_us)]
                )
            )
        robot.advance_to((picture + 1) * PICTURE_US)
        robot.markers_mm()
    return SECONDS / (time.process_time() - before_s)


if __name__ == "__main__":
    main()
