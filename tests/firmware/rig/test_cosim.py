"""The twin's servos get the pulses that are on the simulated board's pins."""

import pytest

from ccr_host.sim.simavr.board import SimavrCoSimulation, SimavrLine

FRAME_US = 20_000


class RecordingScene:
    """Records its inputs, and rejects decreasing times."""

    def __init__(self):
        self.now_us = 0
        self.pulses = []

    def advance_to(self, time_us):
        assert time_us >= self.now_us
        self.now_us = time_us

    def set_pulses_half_us(self, pulses_half_us):
        self.pulses.append((self.now_us, pulses_half_us))


@pytest.mark.parametrize("slice_us", [137, 1000, 50_000])
def test_each_pulse_reaches_the_servo_when_it_ends(board, slice_us):
    line = SimavrLine(board("servo"))
    scene = RecordingScene()
    together = SimavrCoSimulation(line, scene)
    together.advance_to(1000)
    line.write(b"ab")
    for time_us in range(1000 + slice_us, 120_000, slice_us):
        together.advance_to(time_us)
    first = [(time_us % FRAME_US, pulses) for time_us, pulses in scene.pulses[:4]]
    start = first[0][0] - 1000  # the program's start-up
    assert 0 <= start < 100
    assert [pulses for _, pulses in first[:2]] == [(0, 2000), (3000, 2000)]
    assert {time_us - start for time_us, _ in first} <= {999, 1000, 1001, 1499, 1500, 1501}


def test_servo_without_pulses_is_reported(board):
    line = SimavrLine(board("servo"))
    scene = RecordingScene()
    together = SimavrCoSimulation(line, scene)
    together.advance_to(1000)
    line.write(b"ab")
    together.advance_to(3 * FRAME_US)
    line.write(b"x")
    together.advance_to(6 * FRAME_US)
    assert scene.pulses[-1][1] == (0, 0)
