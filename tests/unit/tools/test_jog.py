"""Jogging on the emulated board, in virtual time."""

from ccr_host.link.messages import State
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions
from ccr_host.run.rig import Rig
from ccr_host.tools.jog import JogView, jog

OPTIONS = RigOptions()


def jogged(rig: Rig, keys: list[str]) -> list[JogView]:
    """One key per period."""
    left, seen = [*keys, "q"], []
    jog(rig, OPTIONS.description(), lambda: [left.pop(0)] if left else [], seen.append)
    return seen


def test_a_board_that_was_stopped_before_can_be_cleared_by_key() -> None:
    with open_rig(OPTIONS, OPTIONS.description(), Observers()) as rig:
        rig.client.stop()
        seen = jogged(rig, ["", "c", ""])
        assert "stopped" in seen[0].trouble
        assert not seen[-1].trouble
        assert rig.client.read_state().state is State.DISARMED
