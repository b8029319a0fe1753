"""Reads what a run has left: python examples/read_run.py runs/NAME."""

import sys

import numpy as np

import ccr_host


def main(folder: str) -> None:
    """Print the errors and events of a run."""
    run = ccr_host.load_run(folder)
    steps = run.steps  # columns by name; pandas.DataFrame(steps) makes a table of them
    print(f"{run.summary['path']} under {run.summary['controller']}: {len(steps['step'])} steps")
    error_mm = steps["error_mm"]
    print(f"error: mean {np.nanmean(error_mm):.2f} mm, greatest {np.nanmax(error_mm):.2f} mm")
    for row in np.argsort(np.nan_to_num(error_mm))[:-4:-1]:
        print(f"  step {steps['step'][row]} at {steps['time_s'][row]:g} s: {error_mm[row]:.2f} mm")
    for text in run.table("events")["text"]:
        print(f"event: {text}")


if __name__ == "__main__":
    main(sys.argv[1])
