"""Recovery time of the error after a payload or a push, at 20 Hz on the twin.

    python bench/disturbances.py [--robot NAME] [--set KEY=VALUE ...] [--seed N]

A payload of 5 g is attached at 20, 40 or 60 s of the path; a push of 0.05 N lasts 5 s from 40 s on,
along each axis. The error has recovered when its mean over one second stays for two seconds within
1.5 times its value there without the disturbance, or its average over the path if that is larger.
The loaded robot has another floor: after the payload, the larger of the errors without it and with
it from the start is used.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from ccr_host.robot.paths import PAPER_PATHS
from ccr_host.run.execute import execute
from ccr_host.run.observer import RunObserver, true_errors_mm
from ccr_host.run.options import RunOptions

Array = NDArray[np.float64]

RATE_HZ = 20
PAYLOAD_G, PAYLOAD_STARTS_S = 5.0, (20, 40, 60)
PUSH_N, PUSH_SPAN_S = 0.05, (40, 45)
ALLOWED = 1.5
AVERAGED_STEPS = RATE_HZ
HELD_STEPS = 2 * RATE_HZ
WATCHED_S = 15


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot")
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    base = arguments.robot, tuple(arguments.overrides), arguments.seed
    print("| path | disturbance | maximum mm | back after s | push's end: back after s |")
    print("|---|---|---|---|---|")
    for path in PAPER_PATHS:
        alone_mm = errors_mm(path, *base)
        loaded_mm = errors_mm(path, *base, f"twin.payload_g={PAYLOAD_G}")
        for start_s in PAYLOAD_STARTS_S:
            load = f"twin.payload_g={PAYLOAD_G}", f"twin.payload_start_s={start_s}"
            disturbed_mm = errors_mm(path, *base, *load)
            undisturbed_mm = np.maximum(averaged(alone_mm), averaged(loaded_mm))
            row = f"{PAYLOAD_G:g} g at {start_s} s", disturbed_mm, undisturbed_mm
            print_row(path, *row, (start_s,))
        for axis, name in enumerate("xyz"):
            for sense in (1.0, -1.0):
                force_n = np.zeros(3)
                force_n[axis] = sense * PUSH_N
                begin_s, end_s = PUSH_SPAN_S
                push = f"force_n={force_n.tolist()},start_s={begin_s}.0,end_s={end_s}.0"
                disturbed_mm = errors_mm(path, *base, f"twin.push={{{push}}}")
                row = f"{sense * PUSH_N:+g} N {name}", disturbed_mm, averaged(alone_mm)
                print_row(path, *row, PUSH_SPAN_S)


def errors_mm(
    path: str, robot: str | None, overrides: tuple[str, ...], seed: int, *changes: str
) -> Array:
    """True error of each step, mm."""
    options = RunOptions(
        path=path,
        rate_hz=float(RATE_HZ),
        robot=robot,
        overrides=(*overrides, *changes),
        seed=seed,
    )
    result = execute(options, RunObserver(), lambda *_: None)
    errors = true_errors_mm(result.records)
    if errors is None or len(errors) < len(result.reference):
        raise SystemExit(f"{path} with {changes} ended early: {result.failure}")
    return np.asarray(np.linalg.norm(errors, axis=1))


def averaged(errors: Array) -> Array:
    """Mean over the second before each step."""
    sums = np.cumsum(np.concatenate((np.full(AVERAGED_STEPS, errors[0]), errors)))
    return np.asarray((sums[AVERAGED_STEPS:] - sums[:-AVERAGED_STEPS]) / AVERAGED_STEPS)


def back_after_s(disturbed: Array, undisturbed: Array, from_s: float, until_s: float) -> float:
    """Recovery time, s; NaN if the error does not recover before ``until_s``."""
    within = averaged(disturbed) <= ALLOWED * np.maximum(undisturbed, undisturbed.mean())
    first, last = round(from_s * RATE_HZ), min(round(until_s * RATE_HZ), len(within))
    for step in range(first, last):
        if within[step : min(step + HELD_STEPS, last)].all():
            return (step - first) / RATE_HZ
    return float("nan")


def print_row(
    path: str, what: str, disturbed: Array, undisturbed: Array, starts_s: tuple[int, ...]
) -> None:
    """Measure one disturbance; each start is observed until the next one."""
    ends_s = (*starts_s[1:], starts_s[-1] + WATCHED_S)
    back_s = [
        back_after_s(disturbed, undisturbed, start, end)
        for start, end in zip(starts_s, ends_s, strict=True)
    ]
    shown = [f"{seconds:.2f}" for seconds in back_s] + [""] * (2 - len(back_s))
    first = starts_s[0] * RATE_HZ
    greatest = disturbed[first : first + WATCHED_S * RATE_HZ].max()
    print(f"| {path} | {what} | {greatest:.1f} | {' | '.join(shown)} |", flush=True)


if __name__ == "__main__":
    main()
