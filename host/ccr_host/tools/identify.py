"""``ccr-host calibrate --identify``: a tour of rests, kept as measured for `adaptive` to fit."""

from __future__ import annotations

import datetime
from typing import Any

import tomlkit
from tomlkit.items import Array

from ccr_host.control.adaptive.identification import Fit, Rests, Scaling
from ccr_host.control.adaptive.identified import digest_of
from ccr_host.control.adaptive.rest_survey import fit_to
from ccr_host.core.errors import TrackerError
from ccr_host.description.schema import Description

SECTION = "identified"
_ANGLE_DECIMALS, _LENGTH_DECIMALS = 6, 4


def trial_fit(rests: Rests, description: Description) -> Fit:
    """Fit the controller's model as it will do, to see whether the rests are good for it.

    Raises:
        TrackerError: no robot of the kind rests there.
    """
    fit = fit_to(Scaling.of(description), rests)
    if fit is None:
        raise TrackerError(
            f"{len(rests.count)} rests were seen, and no robot as described rests there",
            "check the markers with ccr-host monitor, and segment lengths and pulleys in [robot]",
        )
    return fit.finish()


def identified_section(
    rests: Rests, description: Description, date: datetime.date
) -> dict[str, Any]:
    """The keys of ``[identified]``, rounded to less than the board or the camera resolves."""
    return {
        "start_rad": rests.start_rad.round(_ANGLE_DECIMALS).tolist(),
        "setpoint_rad": _rows(rests.setpoint_rad.round(_ANGLE_DECIMALS).tolist()),
        "tip_mm": _rows(rests.tip_mm.round(_LENGTH_DECIMALS).tolist()),
        "middle_mm": _rows(rests.markers_mm[:, 0].round(_LENGTH_DECIMALS).tolist()),
        "count": [int(count) for count in rests.count],
        "valid_for": digest_of(description),
        "date": date,
    }


def _rows(rows: list[list[float]]) -> Array:
    array = tomlkit.array()
    array.extend(rows)
    return array.multiline(True)
