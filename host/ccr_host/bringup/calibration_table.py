"""What ``ccr-host calibrate`` has found, for people to read."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from ccr_host.bringup.servo_fit import ServoFit
from ccr_host.config import Description


def calibration_table(fit: ServoFit, description: Description) -> Table:
    """A line for each servo."""
    robot = description.robot
    described_gain = robot.pulley_radius_mm / robot.tendon_radius_mm
    table = Table(
        title="mounting of the servos",
        title_justify="left",
        caption=f"{fit.residual}; +-: standard deviation; take-up: motor "
        "angle, and length of tendon, that takes up the slack; gain: bending over motor angle, "
        f"described {described_gain:.2f} (r_p / r_c)",
        caption_justify="left",
    )
    for heading in ("motor", "direction", "neutral (deg)", "take-up", "gain"):
        table.add_column(heading, justify="right")
    for axis in (0, 1):
        take_up_rad = fit.take_up_rad[axis]
        table.add_row(
            str(axis + 1),
            "as described" if fit.direction[axis] > 0 else "reversed",
            f"{np.degrees(fit.neutral_rad[axis]):.2f} "
            f"+- {np.degrees(fit.neutral_deviation_rad[axis]):.2f}",
            f"{np.degrees(take_up_rad):.1f} deg, {take_up_rad * robot.pulley_radius_mm:.2f} mm",
            f"{fit.gain[axis]:.2f}",
        )
    return table
