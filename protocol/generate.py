"""Makes from spec.toml everything that is derived from it.

    python protocol/generate.py           write the files
    python protocol/generate.py --check   only compare; exit status 1 names the stale ones

Needs nothing but pydantic and jinja2.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ccr_protocol import cpp, markdown, matlab, python, vectors
from ccr_protocol.load import SpecError, load
from ccr_protocol.spec import Spec

_PROTOCOL = Path(__file__).resolve().parent
_ROOT = _PROTOCOL.parent


def derived_files(spec: Spec) -> dict[str, str]:
    """Text of every derived file, by its path from the root of the repository."""
    return {
        "firmware/lib/protocol/ccr_messages.h": cpp.generate(spec),
        "host/ccr_host/link/messages.py": python.generate(spec),
        "matlab/+ccr/spec.m": matlab.generate(spec),
        "protocol/reference.md": markdown.generate(spec),
        "protocol/vectors.json": vectors.generate(spec),
    }


def stale_files(files: dict[str, str], root: Path) -> list[str]:
    """Paths whose file is absent or says something else."""
    return [path for path, text in files.items() if _read(root / path) != text]


def _read(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.is_file() else None


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit status: 1 stale files, 2 a bad spec."""
    parser = argparse.ArgumentParser(description="Make everything that is derived from the spec.")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    parser.add_argument("--spec", type=Path, default=_PROTOCOL / "spec.toml", help="the spec")
    parser.add_argument("--root", type=Path, default=_ROOT, help="where the derived files lie")
    options = parser.parse_args(arguments)
    try:
        files = derived_files(load(options.spec))
    except (SpecError, vectors.CaseError) as error:
        print(error, file=sys.stderr)
        return 2
    stale = stale_files(files, options.root)
    for path in stale:
        if options.check:
            print(f"{path} is stale: run protocol/generate.py", file=sys.stderr)
        else:
            target = options.root / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(files[path], encoding="utf-8", newline="\n")
            print(f"wrote {path}")
    return 1 if options.check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
