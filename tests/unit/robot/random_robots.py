"""Kinematics of robots of any kind by other means."""

from __future__ import annotations

import numpy as np
import scipy

from ccr_host.description.schema import Robot

TO_PAPER = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def freedom_of(robot: Robot) -> list[tuple[int, np.ndarray]]:
    """Segment and direction of each degree of freedom."""
    freedom = []
    for number, segment in enumerate(robot.segments):
        angle = np.radians(segment.direction_deg)
        planar = [np.array([np.cos(angle), np.sin(angle)])]
        freedom += [(number, d) for d in (planar if segment.bends == "plane" else np.eye(2))]
    return freedom


def levers_of(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """What the degrees of freedom take of each tendon, and what the motors wind of it."""
    tendons = [(last, t) for last, s in enumerate(robot.segments) for t in s.tendons]
    levers = np.zeros((len(tendons), len(freedom_of(robot))))
    wound = np.zeros((len(tendons), max(t.motor for _, t in tendons)))
    for row, (last, tendon) in enumerate(tendons):
        angle = np.radians(tendon.angle_deg)
        towards = np.array([np.cos(angle), np.sin(angle)])
        for column, (number, direction) in enumerate(freedom_of(robot)):
            if number <= last:
                radius = robot.segments[number].tendon_radius_mm
                levers[row, column] = radius * towards @ direction
        wound[row, tendon.motor - 1] = tendon.winding * robot.pulley_radius_mm
    return levers, wound


def chain_of_transforms(robot: Robot, q_rad: np.ndarray) -> np.ndarray:
    """The tip of (10): each segment is a screw motion, its bending that of its tendons."""
    levers, wound = levers_of(robot)
    bending = np.linalg.lstsq(levers, wound @ q_rad, rcond=None)[0]
    pose = np.eye(4)
    bends = np.zeros((len(robot.segments), 2))
    for angle, (number, direction) in zip(bending, freedom_of(robot), strict=True):
        bends[number] += angle * direction
    for segment, (x, y) in zip(robot.segments, bends, strict=True):
        twist = np.zeros((4, 4))
        twist[:3, 2] = twist[2, :3] = x, y, 0.0
        twist[2, :2] *= -1.0
        twist[2, 3] = segment.length_mm
        pose = pose @ scipy.linalg.expm(twist)
    marker = np.array([0.0, robot.marker_offset_mm, 0.0, 1.0])
    tip: np.ndarray = TO_PAPER @ (pose @ marker - marker)[:3]
    return tip
