"""What scripts read: the JSON summary, alone on standard output."""

from __future__ import annotations

import json
import sys
from typing import Any


def print_json(content: dict[str, Any]) -> None:
    """One object on one line."""
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()
