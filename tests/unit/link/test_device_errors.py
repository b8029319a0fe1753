import pytest

from ccr_host.link import messages as m
from ccr_host.link.device_errors import BoardFaultError, BoardResetError, RequestRefusedError


def errors():
    yield from (BoardFaultError(fault) for fault in m.Fault)
    yield from (BoardResetError(cause) for cause in m.ResetCause)
    for code in m.NackCode:
        yield from (RequestRefusedError(m.SetLimits, code, detail) for detail in (0, 1, 7, 255))


@pytest.mark.parametrize("error", list(errors()), ids=repr)
def test_everything_a_board_can_say_has_a_cause_and_a_cure_on_one_line(error):
    assert error.cause
    assert error.cure
    assert "\n" not in str(error)
    assert error.exit_status == 3


def test_refusal_says_what_was_wrong_where():
    assert "(hold)" in str(RequestRefusedError(m.Arm, m.NackCode.BAD_STATE, m.State.HOLD))
    assert "(axis 2)" in str(RequestRefusedError(m.SetLimits, m.NackCode.INCONSISTENT, 1))
    assert "(field 3)" in str(RequestRefusedError(m.SetLimits, m.NackCode.OUT_OF_RANGE, 3))
    assert "(slew missing)" in str(RequestRefusedError(m.Arm, m.NackCode.NOT_CONFIGURED, 2))
