"""Whether two versions of the program do the same: summaries and bytes sent of a broad set of runs.

    python -m bench.same_runs keep .venv/bin/ccr-host before.json
    python -m bench.same_runs compare before.json after.json

All runs are in virtual time, so that equal versions give equal bytes. A set took 7 minutes on two
busy cores.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

PATHS = ("ellipse", "8shape", "star")
CONTROLLERS = ("open-loop", "mpc", "adaptive", "pid-ik", "broyden", "kalman-jacobian", "mpc-offset")
MEASURES = {"open", "solve_us", "wall_s", "missed_deadlines"}
"""Keys of the summary that depend on the machine, or on a second run."""
RUNS = [
    *(f"{path} --controller {controller}" for path, controller in product(PATHS, CONTROLLERS)),
    *(f"8shape --rate 20 --controller {controller}" for controller in CONTROLLERS),
    *(f"star --rate 5 --seed 2 --controller {controller}" for controller in ("mpc", "adaptive")),
    *(
        f"8shape --controller {controller} --set control.solver=compiled"
        for controller in ("mpc", "adaptive")
    ),
    "8shape --controller mpc --set control.horizon=10",
    "8shape --controller mpc --robot hard",
    "8shape --controller adaptive --robot hard",
    "8shape --controller adaptive --laps 2 --set twin.servo_neutral_us=[1533,1467]",
    *(
        f"8shape --controller {controller} --tracker ndi-emulator: --set {turned}"
        for controller in ("mpc", "adaptive")
        for turned in ("tracker.rotation_deg=[0,0,0]", "tracker.rotation_deg=[3,-2,10]")
    ),
    *(f"ellipse --controller {controller} --device simavr:" for controller in ("mpc", "adaptive")),
    "8shape --no-open --controller mpc --set twin.servo_us_per_90_deg=[-1000,1000]",
]


def kept(program: str, words: str) -> dict[str, Any]:
    """Status, summary and a digest of all bytes that were sent to the board."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [program, "track", *words.split(), "--no-open", "--json", "--out", folder],
            capture_output=True,
            text=True,
            check=False,
        )
        sent = hashlib.sha256()
        for file in sorted(Path(folder).glob("log_*.mcap")):
            with file.open("rb") as stream:
                for _, _, message in make_reader(stream).iter_messages(topics=["/link/sent"]):
                    sent.update(json.loads(message.data)["hex"].encode())
    summary = json.loads(done.stdout) if done.stdout else {"errors": done.stderr}
    return {
        "status": done.returncode,
        "sent": sent.hexdigest(),
        **{key: value for key, value in summary.items() if key not in MEASURES},
    }


def keep(program: str, out: str) -> None:
    """All runs, two at a time, into a file."""
    with ThreadPoolExecutor(2) as pool:
        results = dict(zip(RUNS, pool.map(lambda words: kept(program, words), RUNS), strict=True))
    Path(out).write_text(json.dumps(results, indent=1) + "\n")


def compare(before: str, after: str) -> None:
    """Name what differs, and how many runs are the same to the byte."""
    old, new = (json.loads(Path(file).read_text()) for file in (before, after))
    common = [words for words in old if words in new]
    for words in common:
        keys = sorted(old[words].keys() | new[words].keys())
        pairs = {key: (old[words].get(key), new[words].get(key)) for key in keys}
        odd = {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}
        if odd:
            print(f"{words}\n" + "".join(f"    {key}: {a} -> {b}\n" for key, (a, b) in odd.items()))
    same = sum(old[words] == new[words] for words in common)
    print(f"the same: {same} of {len(common)} runs")


if __name__ == "__main__":
    {"keep": keep, "compare": compare}[sys.argv[1]](*sys.argv[2:])
