"""Rotation vectors and matrices."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def quaternion(rotation_rad: ArrayLike) -> NDArray[np.float64]:
    """(4,): w, x, y, z of a rotation vector, (3,); w is not negative up to half a turn."""
    vector = np.asarray(rotation_rad, dtype=np.float64)
    half_angle = float(np.linalg.norm(vector)) / 2
    half_sinc = 0.5 * float(np.sinc(half_angle / math.pi))  # without 0/0
    return np.array([math.cos(half_angle), *(half_sinc * vector)])


Array = NDArray[np.float64]


def rotation_matrix(rotation_rad: ArrayLike) -> Array:
    """Turn a rotation vector (3,) into a matrix (3, 3), by Rodrigues' formula."""
    vector = np.asarray(rotation_rad, dtype=np.float64)
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # sin(a)/a and (1 - cos(a))/a^2 without 0/0.
    first = float(np.sinc(angle / math.pi))
    second = 0.5 * float(np.sinc(angle / (2.0 * math.pi))) ** 2
    matrix: Array = np.eye(3) + first * cross + second * cross @ cross
    return matrix


def rotation_vector(matrix: ArrayLike) -> Array:
    """Turn a rotation matrix (3, 3) into the vector (3,) of least length, at most pi long."""
    w, x, y, z = _quaternion(np.asarray(matrix, dtype=np.float64))
    imaginary = np.array([x, y, z]) * (1.0 if w >= 0 else -1.0)
    sine = float(np.linalg.norm(imaginary))
    angle = 2.0 * math.atan2(sine, abs(w))
    vector: Array = imaginary * (angle / sine if sine > 0 else 2.0)
    return vector


def _quaternion(matrix: Array) -> Array:
    """(w, x, y, z): dominant eigenvector of Bar-Itzhack's matrix, good at any angle."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    form = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, yx + xy, zx + xz],
            [xz - zx, yx + xy, yy - xx - zz, zy + yz],
            [yx - xy, zx + xz, zy + yz, zz - xx - yy],
        ]
    )
    quaternion: Array = np.linalg.eigh(form)[1][:, -1]
    return quaternion
