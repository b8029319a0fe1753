"""Moves both motors and prints where the tip goes.

python examples/move_two_motors.py [DEVICE TRACKER], e.g. serial:/dev/ttyACM0 ndi:/dev/ttyUSB0;
without them the digital twin moves.
"""

import sys

import ccr_host


def main(device: str = "emulator:", tracker: str = "twin:") -> None:
    """Visit three poses."""
    with ccr_host.open_robot(device=device, tracker=tracker) as robot:
        robot.arm()
        for q_deg in ([0, 0], [20, 0], [20, -20]):
            robot.move(q_deg)
            y, x, z = robot.tip_mm()
            print(f"motors at {q_deg} deg: tip at x {x:.1f}, y {y:.1f}, z {z:.1f} mm")


if __name__ == "__main__":
    main(*sys.argv[1:])
