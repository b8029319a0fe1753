"""Holds spec.toml against the released specs in released/.

    python protocol/check_compatibility.py

Exit status 1 and one line for each change that is not allowed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ccr_protocol.compatibility import needs_new_version, never_allowed
from ccr_protocol.load import SpecError, load
from ccr_protocol.spec import Spec

_PROTOCOL = Path(__file__).resolve().parent


def violations(released: list[Spec], spec: Spec) -> list[str]:
    """Changes that are not allowed, against every release and against the latest one."""
    found = [text for old in released for text in never_allowed(old, spec)]
    latest = max(released, key=lambda old: old.version, default=None)
    if latest is not None and spec.version == latest.version:
        found += [
            f"{text}; raise protocol.version above {latest.version}"
            for text in needs_new_version(latest, spec)
        ]
    return list(dict.fromkeys(found))


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status: 1 violations, 2 a bad spec."""
    parser = argparse.ArgumentParser(description="Hold the spec against the released ones.")
    parser.add_argument("--spec", type=Path, default=_PROTOCOL / "spec.toml", help="the spec")
    parser.add_argument(
        "--released", type=Path, default=_PROTOCOL / "released", help="folder of released specs"
    )
    options = parser.parse_args(arguments)
    try:
        spec = load(options.spec)
        released = [load(path) for path in sorted(options.released.glob("*.toml"))]
    except SpecError as error:
        print(error, file=sys.stderr)
        return 2
    if not released:
        print(f"{options.released}: there is no released spec to hold it against", file=sys.stderr)
        return 2
    found = violations(released, spec)
    print("\n".join(found), file=sys.stderr, end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
