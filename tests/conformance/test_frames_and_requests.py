"""FRM and REQ: how the board processes bytes."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ccr_host.link import messages as m
from ccr_host.link.framing import Frame, encode_frame
from tests.conformance.device import AXES

SESSION = 0x5E55
HELLO = encode_frame(m.Hello.ID, 7, m.Hello(m.PROTOCOL_VERSION, m.SPEC_HASH).pack())


PULSE_MIN_BELOW_THE_FLOOR = m.Calibration((3000, 3000), (900, 900), (999, 1000), (5000, 5000))
REQUESTS = set(m.REQUESTS)


def damaged(frame: bytes) -> bytes:
    return frame[:3] + bytes([frame[3] ^ 0x10]) + frame[4:]


@pytest.mark.requirement("FRM-1")
@pytest.mark.parametrize(
    ("counter", "data"),
    [
        ("bad_crc", damaged(HELLO)),
        ("bad_encoding", b"\x09\x01\x02\x00"),
        ("bad_size", b"\x01\x00"),
        ("bad_size", b"\x04\x01\x02\x03\x00"),
        ("bad_size", encode_frame(m.Hello.ID, 1, bytes(m.MAX_PAYLOAD.of(AXES) + 1))),
    ],
)
def test_invalid_frames_are_counted_and_not_answered(listening, counter, data):
    assert listening.exchange(data) == []
    counters = listening.counters()
    assert getattr(counters, counter) == 1
    assert counters.bad_crc + counters.bad_encoding + counters.bad_size == 1
    assert counters.frames_accepted == 2  # the end of the exchange, and get_counters itself
    assert listening.link_errors() == 1


@pytest.mark.requirement("FRM-1")
def test_longest_payload_is_taken_as_a_frame(listening):
    (answer,) = listening.exchange(encode_frame(m.Hello.ID, 1, bytes(m.MAX_PAYLOAD.of(AXES))))
    assert m.Nack.unpack(answer.payload).code is m.NackCode.BAD_LENGTH


@pytest.mark.requirement("FRM-2")
@settings(
    max_examples=100,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(noise=st.binary(max_size=300))
def test_next_frame_after_any_bytes_and_a_zero_is_understood(listening, noise):
    (answer,) = listening.talk.ask_frames(noise + b"\0" + HELLO)
    assert (answer.id, answer.sequence) == (m.HelloReply.ID, 7)


@pytest.mark.requirement("FRM-3")
def test_zeros_between_frames_are_ignored(listening):
    answers = listening.exchange(bytes(20) + HELLO + bytes(20) + HELLO)
    assert len(answers) == 2
    assert listening.link_errors() == 0


@pytest.mark.requirement("FRM-4")
def test_frame_that_grows_too_long_is_counted_once(listening):
    listening.device.send(b"\x55" * 1000)
    (answer,) = listening.exchange(b"\x55" * 1000 + b"\0" + HELLO, wait_us=200_000)
    assert answer.id == m.HelloReply.ID
    counters = listening.counters()
    assert (counters.bad_size, counters.bad_encoding, counters.bad_crc) == (1, 0, 0)


@pytest.mark.requirement("REQ-1")
def test_requests_are_answered_in_order_with_their_sequence_numbers(listening):
    requests = [(m.GetState, 9), (m.Stop, 9), (m.GetLimits, 0), (m.GetCounters, 255)]
    data = b"".join(encode_frame(kind.ID, sequence, kind().pack()) for kind, sequence in requests)
    answers = listening.exchange(data)
    assert [(a.id, a.sequence) for a in answers] == [
        (kind.REPLY_ID, sequence) for kind, sequence in requests
    ]


def test_answers_that_do_not_fit_the_send_buffer_are_dropped_and_counted(listening):
    burst = b"".join(encode_frame(m.GetState.ID, n, b"") for n in range(60))
    answers = listening.exchange(burst, wait_us=100_000)
    counters = listening.counters()
    understood = counters.frames_accepted - 2  # what a board's receive buffer has let through
    assert 8 <= len(answers) < understood <= 60
    assert counters.replies_dropped == understood - len(answers)
    assert (understood == 60) == (counters.overruns == 0)


@pytest.mark.requirement("REQ-5")
@pytest.mark.parametrize("request_", [m.GetCounters(), m.GetState(), m.ClockSync(0x01020304)])
def test_as_many_requests_as_may_be_outstanding_are_answered(with_session, request_):
    frame = encode_frame(request_.ID, 1, request_.pack())
    count = min(m.OUTSTANDING_REQUESTS, m.OUTSTANDING_BYTES.of(AXES) // len(frame))
    with_session.done(m.SetTelemetry(SESSION, 1))
    for _ in range(50):
        assert len(with_session.exchange(frame * count)) == count
    assert with_session.counters().replies_dropped == 0


@pytest.mark.requirement("REQ-5", "TIM-5")
@pytest.mark.in_step("the moment of the reset cannot be seen on a port")
def test_as_many_requests_as_may_be_outstanding_are_answered_as_soon_as_the_board_listens(
    make_host,
):
    frame = encode_frame(m.SetCalibration.ID, 1, bytes(m.SetCalibration.size(AXES)))
    shortest = encode_frame(m.GetCounters.ID, 2, b"")
    left = m.OUTSTANDING_BYTES.of(AXES) - 2 * len(frame)
    requests = frame * 2 + shortest * min(m.OUTSTANDING_REQUESTS - 2, left // len(shortest))
    listening = make_host()
    for cause in (m.ResetCause.POWER_ON, m.ResetCause.EXTERNAL):
        listening.reset(cause)
        assert len(listening.exchange(requests)) == requests.count(0)
        assert listening.link_errors() == 0


@pytest.mark.requirement("TIM-5")
@pytest.mark.in_step("a port is opened before its board listens")
def test_what_comes_right_after_a_reset_is_lost(make_host):
    listening = make_host()
    device = listening.device
    device.board.reset(m.ResetCause.EXTERNAL)
    device.send(HELLO)
    device.board.advance_to(device.board.now_us + 50_000)
    assert device.read() == b""


FLOODS = {
    "states": [m.GetState()],
    "counters": [m.GetCounters()],
    "targets": [m.SetTarget(SESSION, (8000, -5000), 300, 10_000)],
    "targets and states": [m.SetTarget(SESSION, (8000, -5000), 300, 10_000)] * 6 + [m.GetState()],
    "hellos": [m.Hello(m.PROTOCOL_VERSION, m.SPEC_HASH)],
}


@pytest.mark.requirement("REQ-5", "STP-1")
@pytest.mark.parametrize("flood", FLOODS.values(), ids=FLOODS.keys())
@pytest.mark.in_step("a port does not tell how full its line is")
def test_on_a_line_that_never_pauses_each_request_is_obeyed_and_a_stop_is_answered(armed, flood):
    armed.done(m.SetTelemetry(SESSION, 1))
    armed.target(8000, -5000, ramp_ms=10_000)
    before = armed.counters().frames_accepted
    frames = [encode_frame(r.ID, 1, r.pack()) for r in flood]
    repeated = frames * (2000 // len(frames))
    stop = encode_frame(m.Stop.ID, 99, b"")
    data = b"".join(repeated) + stop + b"".join(repeated[:50])
    answers = armed.exchange(data, wait_us=len(data) * 10_000_000 // m.BAUD + 50_000)
    acks = [m.Ack.unpack(a.payload) for a in answers if (a.id, a.sequence) == (m.Ack.ID, 99)]
    assert acks == [m.Ack(m.Stop.ID, m.State.STOPPED)]
    counters = armed.counters()
    assert counters.overruns == 0
    # The end of the exchange and get_counters itself come on top.
    assert counters.frames_accepted - before == len(repeated) + 1 + 50 + 2


@pytest.mark.requirement("REQ-2")
def test_checks_come_in_their_order_and_change_nothing(host):
    host.done(m.Arm(SESSION))
    limits = host.told(m.GetLimits(), m.LimitsReply).limits
    wrong = m.Limits((0, 20000), (0, 0), (0, 0))
    inconsistent = m.Limits((0, 100), (100, 100), (0, 100))
    too_short = host.ask_frame(m.SetLimits.ID, 1, m.SetLimits(SESSION + 1, wrong).pack()[:-1])
    assert m.Nack.unpack(too_short.payload).code is m.NackCode.BAD_LENGTH
    assert host.refusal(m.SetLimits(SESSION + 1, wrong))[0] is m.NackCode.BAD_SESSION
    assert host.refusal(m.SetLimits(SESSION, wrong)) == (m.NackCode.BAD_STATE, m.State.ARMING)
    host.done(m.Stop())
    assert host.refusal(m.SetLimits(SESSION, wrong)) == (m.NackCode.OUT_OF_RANGE, 1)
    assert host.refusal(m.SetLimits(SESSION, inconsistent)) == (m.NackCode.INCONSISTENT, 1)
    assert host.told(m.GetLimits(), m.LimitsReply).limits == limits
    assert host.counters().nacks == 5


@pytest.mark.requirement("REQ-2")
@pytest.mark.parametrize(
    ("request_", "index"),
    [
        (m.OpenSession(m.SPEC_HASH, 0), 1),
        (m.SetWatchdog(SESSION, m.Watchdog(19, 100, 100)), 1),
        (m.SetWatchdog(SESSION, m.Watchdog(100, 501, 100)), 2),
        (m.SetWatchdog(SESSION, m.Watchdog(100, 100, 5001)), 3),
        (m.SetSlew(SESSION, m.Slew((1, 0))), 1),
        (m.SetCalibration(SESSION, PULSE_MIN_BELOW_THE_FLOOR), 3),
    ],
)
def test_out_of_range_names_the_field(host, request_, index):
    assert host.refusal(request_) == (m.NackCode.OUT_OF_RANGE, index)


@pytest.mark.requirement("REQ-2")
@pytest.mark.parametrize("ramp_and_validity", [(10_001, 100), (0, 19), (0, 10_001)])
def test_target_out_of_range_is_refused_and_does_not_feed_the_watchdog(armed, ramp_and_validity):
    answer = armed.refusal(m.SetTarget(SESSION, (0, 0), *ramp_and_validity))
    assert answer == (m.NackCode.OUT_OF_RANGE, 2 if ramp_and_validity[0] else 3)
    assert armed.counters().targets_accepted == 0


@pytest.mark.requirement("REQ-2")
@pytest.mark.parametrize("per_90_deg", [-99, 0, 99])
def test_calibration_without_a_slope_is_inconsistent(host, per_90_deg):
    calibration = m.Calibration((3000, 3000), (900, per_90_deg), (1000, 1000), (5000, 5000))
    answer = host.refusal(m.SetCalibration(SESSION, calibration))
    assert answer == (m.NackCode.INCONSISTENT, 1)


@pytest.mark.requirement("REQ-3")
def test_repeated_request_is_answered_from_memory_and_not_executed_again(host):
    first = host.ask_frame(m.Arm.ID, 5, m.Arm(SESSION).pack())
    host.wait_for(m.State.HOLD)
    assert host.ask_frame(m.Arm.ID, 5, m.Arm(SESSION).pack()) == first
    assert m.Ack.unpack(first.payload).state is m.State.ARMING
    assert host.counters().repeats_answered == 1
    assert host.state() is m.State.HOLD


@pytest.mark.requirement("REQ-3")
def test_memory_lasts_for_the_retry_window_and_no_longer(host):
    request = m.Disarm(SESSION)
    host.done(request, sequence=5)
    executed_before = host.next_tick()
    from_memory = 0
    for last_tick in (m.RETRY_WINDOW_TICKS // 2, m.RETRY_WINDOW_TICKS, m.RETRY_WINDOW_TICKS + 1):
        host.go_past(executed_before + last_tick - 1)
        host.done(request, sequence=5)
        if host.next_tick() - executed_before <= m.RETRY_WINDOW_TICKS:
            from_memory += 1
        else:
            executed_before = host.next_tick()
        assert host.counters().repeats_answered == from_memory
    assert from_memory >= 1


@pytest.mark.requirement("REQ-3")
def test_only_the_same_id_sequence_and_payload_is_a_repetition(host):
    host.done(m.SetTelemetry(SESSION, 0), sequence=5)
    host.done(m.SetTelemetry(SESSION, 0), sequence=6)
    host.done(m.SetTelemetry(SESSION, 9), sequence=6)
    host.done(m.Disarm(SESSION), sequence=6)
    assert host.counters().repeats_answered == 0


@pytest.mark.requirement("REQ-3")
def test_refused_request_is_checked_again_when_repeated(host):
    host.done(m.Stop())
    assert host.refusal(m.Arm(SESSION), sequence=5)[0] is m.NackCode.BAD_STATE
    host.done(m.ClearFault(SESSION))
    host.done(m.Arm(SESSION), sequence=5)


@pytest.mark.requirement("REQ-3", "SES-1")
def test_new_session_forgets_answered_requests(host):
    host.done(m.SetTelemetry(SESSION, 0), sequence=5)
    host.done(m.OpenSession(m.SPEC_HASH, SESSION))
    host.done(m.SetTelemetry(SESSION, 0), sequence=5)
    assert host.counters().repeats_answered == 0


@pytest.mark.requirement("REQ-4")
@pytest.mark.parametrize("message_id", [*sorted({*range(256)} - REQUESTS)[::7], 0x70, 0xC1])
def test_ids_that_are_no_requests_are_refused(listening, message_id):
    answer = listening.ask_frame(message_id, 3, b"\1\2\3")
    assert answer == Frame(m.Nack.ID, 3, m.Nack(message_id, m.NackCode.UNKNOWN_ID, 0).pack())
