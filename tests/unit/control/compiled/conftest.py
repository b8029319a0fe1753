"""The compiled package needs the extra ``fast``."""

from __future__ import annotations

import pytest

pytest.importorskip("numba")
