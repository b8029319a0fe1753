"""How much faster than real time the twin is, with its defaults and with every effect at once.

    nice -n 19 python -m bench.twin_speed

CPU time of robots whose motors move once and twenty times a second, camera at 20 Hz; medians of
interleaved runs.
"""

from __future__ import annotations

import math
import time
from statistics import median
from typing import Any

from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.robot import TwinRobot

RUNS = 5
SECONDS = 6
PICTURE_US = 50_000
TENDONS: dict[str, Any] = {"joint_damping": 1.2e-3, "capstan_friction": 0.22, "friction": 0.1}
STRUCTURE: dict[str, Any] = {
    "creep_share": (0.06, 0.05),
    "torsion_stiffness_nm_rad": 0.3,
    "sideways_stiffness_nm_rad": 0.4,
    "axial_stiffness_n_m": 8000.0,
    "stiffness_taper": 0.13,
    "stiffening": 0.2,
    "bending_plane_turn_deg": 1.3,
}
SERVOS: dict[str, Any] = {
    "servo_stall_torque_nm": 0.6,
    "servo_droop_deg_per_nm": 10.0,
    "servo_backlash_deg": 0.65,
    "servo_deadband_deg": 0.6,
    "servo_lag_ms": 20.0,
    "servo_drift_deg": (1.0, -1.0),
}
TWINS = {
    "defaults": {},
    "friction": TENDONS,
    "structure": STRUCTURE,
    "servos": SERVOS,
    "everything": TENDONS | STRUCTURE | SERVOS,
}


def main() -> None:
    """Measure and print."""
    print("| effects | 1 Hz | 20 Hz |")
    print("|---|---|---|")
    speeds: dict[tuple[str, int], list[float]] = {}
    for _ in range(RUNS):
        for name, keys in TWINS.items():
            for rate_hz in (1, 20):
                speeds.setdefault((name, rate_hz), []).append(times_real_time(keys, rate_hz))
    for name in TWINS:
        print(f"| {name} | {median(speeds[name, 1]):.0f} | {median(speeds[name, 20]):.0f} |")


def times_real_time(keys: dict[str, Any], rate_hz: int) -> float:
    """Simulated seconds in a second of CPU time."""
    robot = TwinRobot(Twin.model_validate(keys))
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
