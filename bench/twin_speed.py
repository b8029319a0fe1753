"""How much faster than real time the simulated robots are; `dirty` has every effect at once.

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
ROBOTS = ("ideal", "paper", "default", "dirty")


def main() -> None:
    """Measure and print."""
    print("| robot | 1 Hz | 20 Hz |")
    print("|---|---|---|")
    speeds: dict[tuple[str, int], list[float]] = {}
    for _ in range(RUNS):
        for name in ROBOTS:
            for rate_hz in (1, 20):
                speeds.setdefault((name, rate_hz), []).append(
                    times_real_time(load(name).twin, rate_hz)
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
            robot.set_pulses_half_us(
                (round(3000 + first_deg * 2000 / 90), round(3000 + second_deg * 2000 / 90))
            )
        robot.advance_to((picture + 1) * PICTURE_US)
        robot.markers_mm()
    return SECONDS / (time.process_time() - before_s)


if __name__ == "__main__":
    main()
