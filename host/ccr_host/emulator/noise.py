"""A bad line: bytes get lost, doubled, or one of their bits flips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LineNoise:
    """Probabilities per byte."""

    rng: np.random.Generator
    drop: float = 0.0
    duplicate: float = 0.0
    flip: float = 0.0

    def corrupt(self, data: bytes) -> bytes:
        """What is left of `data` at the other end."""
        out = bytearray()
        draws = self.rng.random((len(data), 3))
        for byte, (drop, duplicate, flip) in zip(data, draws, strict=True):
            if drop < self.drop:
                continue
            bit = 1 << int(self.rng.integers(8)) if flip < self.flip else 0
            out.append(byte ^ bit)
            if duplicate < self.duplicate:
                out.append(byte ^ bit)
        return bytes(out)
