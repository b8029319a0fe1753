"""A serial line to the emulated board with transmission errors, or unplugged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ccr_host.core.errors import DeviceError
from ccr_host.sim.board.board import SerialLine, UnoEmulator


@dataclass(frozen=True)
class LineNoise:
    """Random transmission errors, as probabilities per byte."""

    rng: np.random.Generator
    drop: float = 0.0
    duplicate: float = 0.0
    flip: float = 0.0

    def corrupt(self, data: bytes) -> bytes:
        """Return `data` as it arrives at the other end."""
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


class FaultyLine(SerialLine):
    def __init__(self, board: UnoEmulator) -> None:
        super().__init__(board)
        self.noise: LineNoise | None = None
        """Transmission errors in both directions."""
        self._plugged_in = True

    def write(self, data: bytes) -> None:
        self._require_plug()
        super().write(self.noise.corrupt(data) if self.noise else data)

    def read(self) -> bytes:
        self._require_plug()
        data = super().read()
        return self.noise.corrupt(data) if self.noise and data else data

    def unplug(self) -> None:
        self._plugged_in = False

    def _require_plug(self) -> None:
        if not self._plugged_in:
            raise DeviceError(f"{self.name}: the port is gone", "plug the board in again")
