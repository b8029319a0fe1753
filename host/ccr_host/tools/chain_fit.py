"""Fit of ``robot.tendon_rest``'s model to tendon travel and marker positions of any robot.

Unknown is what ``robot.rest_model`` lists, with its prior from the description. The fit is scipy's,
with exact derivatives at rest by the implicit function theorem: with g(y, p) = 0, dy = -g_y^-1 g_p
dp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Segment
from ccr_host.robot.rest_model import Markers, RestModel
from ccr_host.robot.tendon_rest import pulled_mm

FloatArray = NDArray[np.float64]

_MODEL_SHARE = 0.015
"""Assumed error of a coordinate, over the length of the robot: what constant curvature leaves on
measured robots (OpenCR v4 1.0 %, v6 1.6 %, fitted to all rows)."""
_ROBUST = 2.0
"""Residuals above this many assumed errors count linearly."""
_MOST_ROWS = 500
"""Rows that are fitted; more are thinned evenly. Neighbouring rows have the same errors."""
_UNLIKE = 0.05
"""Correlation below which the residuals of two rows count as independent."""
_PROBE = 1e-5
_MOST_STEPS = 40
_ONE_PLANE = 0.17
"""Bending across the main plane over that in it, at most: 10 deg."""


class ChainModel(RestModel):
    """The model of a described robot at the rows of a measurement.

    Args:
        segments: as described.
        travel_mm: pull of each motor at all rows, (N, M), in the order in which they were visited.
        markers: what is measured; by default the tip.
    """

    def __init__(
        self,
        segments: tuple[Segment, ...],
        travel_mm: FloatArray,
        markers: Markers | None = None,
    ) -> None:
        super().__init__(segments, markers)
        self._wound_mm = travel_mm @ self.winding.T

    def travel_mm(self, score: FloatArray) -> FloatArray:
        """Pull of each tendon behind its dead travel, (N, T): the play operator over all rows."""
        half_mm = self.half_dead_mm(score)
        behind = self._wound_mm[0]
        rows: FloatArray = np.empty_like(self._wound_mm)
        for number, wound_mm in enumerate(self._wound_mm):
            behind = pulled_mm(behind, wound_mm, half_mm)
            rows[number] = behind
        return rows

    def predicted_mm(self, score: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
        """Markers of some rows in the frame of the measurement, (n, ends, 3)."""
        robot = self.robot(score)
        return self.seen_mm(score, robot, robot.rest(self.travel_mm(score)[rows]))

    def bend_rad(self, score: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
        """Bending vectors of some rows, (n, S, 2)."""
        robot = self.robot(score)
        return robot.bend_rad(robot.rest(self.travel_mm(score)[rows]))

    def in_one_plane(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the description bends all segments within one plane there, (n,)."""
        sizes = np.linalg.svd(self.bend_rad(self.nothing, rows), compute_uv=False)
        across = sizes[:, 1] if sizes.shape[1] > 1 else np.zeros(len(rows))
        return np.asarray(across <= _ONE_PLANE * sizes[:, 0])

    def slope(self, score: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
        """Derivatives of the markers at rest by the scores, (n, ends, 3, P)."""
        robot, travel_mm = self.robot(score), self.travel_mm(score)[rows]
        y = robot.rest(travel_mm)
        _, by_y = self.ends_by(score, robot, y)
        by_y = self.turn(score) @ by_y
        yielding = np.linalg.inv(robot.stiffness_matrix(y, travel_mm))
        here_mm, moments = self.seen_mm(score, robot, y), robot.moments(y, travel_mm)
        slope = np.empty((*here_mm.shape, len(score)))
        for number, unknown in enumerate(self.unknowns):
            near = score.copy()
            near[number] += _PROBE
            other = self.robot(near)
            led_mm = self.travel_mm(near)[rows] if unknown.kind == "dead_travel" else travel_mm
            more = (other.moments(y, led_mm) - moments) / _PROBE
            moved = -np.einsum("nde,ne->nd", yielding, more)
            seen = (self.seen_mm(near, other, y) - here_mm) / _PROBE
            slope[..., number] = seen + np.einsum("neiy,ny->nei", by_y, moved)
        return slope

    def align(self, seen_mm: FloatArray, rows: NDArray[np.intp]) -> None:
        """Place the robot so that its markers are nearest to those seen, (n, ends, 3)."""
        self.frame = np.eye(3), np.zeros(3)
        expected_mm = self.predicted_mm(self.nothing, rows).reshape(-1, 3)
        seen_mm = seen_mm.reshape(-1, 3)
        is_free = float(not self._markers.are_from_base)
        middle_mm, expected_middle_mm = (
            is_free * points.mean(axis=0) for points in (seen_mm, expected_mm)
        )
        turn, _ = Rotation.align_vectors(seen_mm - middle_mm, expected_mm - expected_middle_mm)
        matrix = turn.as_matrix()
        self.frame = matrix, middle_mm - matrix @ expected_middle_mm


@dataclass(frozen=True, eq=False)
class ChainFit:
    """The fitted model: ``score`` (P,), its ``covariance`` (P, P)."""

    model: ChainModel
    score: FloatArray
    covariance: FloatArray

    def predicted_mm(self, rows: NDArray[np.intp]) -> FloatArray:
        """Markers of some rows, (n, ends, 3)."""
        return self.model.predicted_mm(self.score, rows)


def fit_chain(model: ChainModel, seen_mm: FloatArray, rows: NDArray[np.intp]) -> ChainFit:
    """Fit to some rows.

    The covariance counts rows with errors alike as one, and takes the residual for the error of the
    model.

    Args:
        model: the model of all rows.
        seen_mm: measured markers of all rows, (N, ends, 3).
        rows: the rows to fit, in order.
    """
    fitted = _thinned(rows)
    model.align(seen_mm[fitted], fitted)
    assumed_mm = _MODEL_SHARE * model.length_mm
    prior = np.eye(len(model.unknowns))

    def residuals(score: FloatArray) -> FloatArray:
        off_mm = model.predicted_mm(score, fitted) - seen_mm[fitted]
        return np.append(off_mm.ravel() / assumed_mm, score)

    def slope(score: FloatArray) -> FloatArray:
        by_score = model.slope(score, fitted).reshape(-1, len(score))
        return np.concatenate([by_score / assumed_mm, prior])

    found = least_squares(
        residuals,
        model.nothing,
        slope,
        loss="huber",
        f_scale=_ROBUST,
        ftol=1e-5,
        xtol=1e-4,
        max_nfev=_MOST_STEPS,
    )
    off_mm = seen_mm[fitted] - model.predicted_mm(found.x, fitted)
    larger = max(1.0, float((off_mm**2).mean()) / assumed_mm**2)
    by_score = slope(found.x)[: -len(prior)]
    information = by_score.T @ by_score / (larger * _rows_alike(off_mm)) + prior
    return ChainFit(model, found.x, np.asarray(np.linalg.inv(information)))


def _rows_alike(off_mm: FloatArray) -> float:
    """How many successive rows count as one, from the autocorrelation of their residuals."""
    centred = off_mm - off_mm.mean(axis=0)
    power = float((centred**2).sum()) or 1.0
    rows = 1.0
    for lag in range(1, len(off_mm)):
        alike = float((centred[lag:] * centred[:-lag]).sum()) / power
        if alike < _UNLIKE:
            break
        rows += 2.0 * alike
    return rows


def _thinned(rows: NDArray[np.intp]) -> NDArray[np.intp]:
    return rows[:: max(1, -(-len(rows) // _MOST_ROWS))]
