"""TX replies with random contents, written by the emulator's formatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ccr_host.sim.polaris.sensor import BitOrder, StrayList, ToolLine, format_tx

MODE = 0x1801


@dataclass
class Contents:
    """What a reply says, in the resolution of the protocol."""

    tools: list[ToolLine]
    strays: StrayList
    status: int

    def text(self) -> str:
        return format_tx(MODE, self.tools, self.strays, self.status, BitOrder.FIRST_IS_HIGHEST)


def hundredths(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.integers(-999_999, 1_000_000, shape) / 100


def random_contents(rng: np.random.Generator) -> Contents:
    tools = []
    for handle in range(1, 1 + rng.integers(0, 7)):
        pose = {}
        if rng.random() < 0.7:
            q = rng.standard_normal(4)
            q = np.round(q / np.linalg.norm(q) * 10_000) / 10_000
            pose = {"position_mm": hundredths(rng, 3), "quaternion": q}
        status, frame = (int(value) for value in rng.integers(0, 2**32, 2))
        tools.append(ToolLine(handle, status & ~0x40, frame, **pose))
    count = int(rng.integers(0, 51 if rng.random() < 0.1 else 8))
    strays = StrayList(hundredths(rng, count, 3), rng.random(count) < 0.8)
    return Contents(tools, strays, int(rng.integers(0, 2**16)))
