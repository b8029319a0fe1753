"""Fit of ``robot.tendon_rest``'s model to tendon travel and marker positions of any robot.

Unknown is what ``robot.rest_model`` lists, with its prior from the description. The fit is scipy's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ccr_host.core.arrays import Array, BoolArray, IntArray
from ccr_host.description.schema import Segment
from ccr_host.robot.rest_model import Markers, RestModel

_MODEL_SHARE = 0.015
"""Assumed error of a coordinate, over the length of the robot: what constant curvature leaves on
measured robots (OpenCR v4 1.0 %, v6 1.6 %, fitted to all rows)."""
_ROBUST = 2.0
"""Residuals above this many assumed errors count linearly."""
_MOST_ROWS = 500
"""Rows that are fitted; more are thinned evenly. Neighbouring rows have the same errors."""
_UNLIKE = 0.05
"""Correlation below which the residuals of two rows count as independent."""
_MOST_STEPS = 40
_ONE_PLANE = 0.17
"""Bending across the main plane over that in it, at most: 10 deg."""


class ChainModel(RestModel):
    """The model of a described robot at the rows of a measurement.

    Args:
        segments: as described.
        travel_mm: pull of each motor at all rows, (N, M), in the order in which they were visited.
        markers: what is measured; by default the end of the backbone.
    """

    def __init__(
        self,
        segments: tuple[Segment, ...],
        travel_mm: Array,
        markers: Markers | None = None,
    ) -> None:
        super().__init__(segments, markers)
        self._wound_mm = travel_mm @ self.winding.T

    def rest(self, score: Array, rows: IntArray, start: Array | None = None) -> Array:
        """Degrees of freedom of some rows from a guess, both (n, D)."""
        return self.robot(score).rest(self._travel_mm(rows, score), start)

    def predicted_mm(self, score: Array, rows: IntArray, start: Array | None = None) -> Array:
        """Markers of some rows in the frame of the measurement, (n, ends, 3)."""
        return self.robot(score).seen_mm(self.rest(score, rows, start))

    def bend_rad(self, score: Array, rows: IntArray) -> Array:
        """Bending vectors of some rows, (n, S, 2)."""
        return self.robot(score).bend_rad(self.rest(score, rows))

    def in_one_plane(self, rows: IntArray) -> BoolArray:
        """Whether the description bends all segments within one plane there, (n,)."""
        sizes = np.linalg.svd(self.bend_rad(self.nothing, rows), compute_uv=False)
        across = sizes[:, 1] if sizes.shape[1] > 1 else np.zeros(len(rows))
        return np.asarray(across <= _ONE_PLANE * sizes[:, 0])

    def slope(self, score: Array, rows: IntArray, y: Array) -> Array:
        """Derivatives of the markers at rest, y, by the scores, (n, ends, 3, P)."""
        return self.slopes(score, self.robot(score), y, partial(self._travel_mm, rows)).markers

    def _travel_mm(self, rows: IntArray, score: Array) -> Array:
        return self.travel_mm(score, self._wound_mm)[rows]

    def align(self, seen_mm: Array, rows: IntArray) -> None:
        """Place the robot so that its markers are nearest to those seen, (n, ends, 3)."""
        self.frame = np.eye(3), np.zeros(3)
        is_seen = np.isfinite(seen_mm).all(axis=-1)
        expected_mm, seen_mm = self.predicted_mm(self.nothing, rows)[is_seen], seen_mm[is_seen]
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
    score: Array
    covariance: Array

    def predicted_mm(self, rows: IntArray) -> Array:
        """Markers of some rows, (n, ends, 3)."""
        return self.model.predicted_mm(self.score, rows)


def fit_chain(model: ChainModel, seen_mm: Array, rows: IntArray) -> ChainFit:
    """Fit to some rows.

    The covariance counts rows with errors alike as one, and takes the residual for the error of the
    model.

    Args:
        model: the model of all rows.
        seen_mm: measured markers of all rows, (N, ends, 3), NaN if not seen.
        rows: the rows to fit, in order.
    """
    fitted = _thinned(rows)
    model.align(seen_mm[fitted], fitted)
    assumed_mm = _MODEL_SHARE * model.length_mm
    prior = np.eye(len(model.unknowns))
    rested = model.rest(model.nothing, fitted)
    is_seen = np.isfinite(seen_mm[fitted])

    def residuals(score: Array) -> Array:
        off_mm = (model.predicted_mm(score, fitted, rested) - seen_mm[fitted])[is_seen]
        return np.append(off_mm / assumed_mm, score)

    def slope(score: Array) -> Array:
        nonlocal rested  # The next scores are near those at which slopes are asked for.
        rested = model.rest(score, fitted, rested)
        by_score = model.slope(score, fitted, rested)[is_seen]
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
    larger = max(1.0, float((off_mm[is_seen] ** 2).mean()) / assumed_mm**2)
    by_score = slope(found.x)[: -len(prior)]
    alike = _rows_alike(np.where(is_seen, off_mm, 0.0))
    information = by_score.T @ by_score / (larger * alike) + prior
    return ChainFit(model, found.x, np.asarray(np.linalg.inv(information)))


def _rows_alike(off_mm: Array) -> float:
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


def _thinned(rows: IntArray) -> IntArray:
    return rows[:: max(1, -(-len(rows) // _MOST_ROWS))]
