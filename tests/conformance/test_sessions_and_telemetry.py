"""SES and TEL."""

import pytest

from ccr_host.link import messages as m
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.device import AXES

SESSION = 0x5E55
UNKNOWN = m.ResetCause.UNKNOWN


def requests_with_a_session(session):
    limits = m.Limits((0, 0), (1, 1), (0, 0))
    calibration = m.Calibration((3000, 3000), (900, 900), (1000, 1000), (5000, 5000))
    return [
        m.SetTelemetry(session, 1),
        m.Arm(session),
        m.Disarm(session),
        m.ClearFault(session),
        m.SetTarget(session, (0, 0), 0, 100),
        m.SetLimits(session, limits),
        m.SetSlew(session, m.Slew((1, 1))),
        m.SetWatchdog(session, m.Watchdog(100, 100, 100)),
        m.SetCalibration(session, calibration),
        m.SaveConfig(session),
    ]


@pytest.mark.requirement("SES-1")
def test_nothing_that_changes_something_works_without_a_session(started):
    started.boot()
    for request in requests_with_a_session(0) + requests_with_a_session(SESSION):
        assert started.refusal(request) == (m.NackCode.BAD_SESSION, 0)
    assert not started.report().flags & m.StatusFlags.SESSION_OPEN


@pytest.mark.requirement("SES-1")
def test_second_session_ends_the_first(host):
    host.open_session(SESSION + 1)
    for request in requests_with_a_session(SESSION):
        assert host.refusal(request) == (m.NackCode.BAD_SESSION, 0)
    host.done(m.Arm(SESSION + 1))


@pytest.mark.requirement("SES-2")
def test_another_spec_gets_no_session_and_leaves_the_open_one(host):
    answer = host.refusal(m.OpenSession(m.SPEC_HASH ^ 1, SESSION + 1))
    assert answer == (m.NackCode.SPEC_MISMATCH, 0)
    host.done(m.SetTelemetry(SESSION, 0))


@pytest.mark.requirement("SES-3")
def test_reset_closes_the_session_ends_telemetry_and_counts_up(host):
    boot_id = host.hello().boot_id
    host.done(m.SetTelemetry(SESSION, 1))
    host.reset()
    hello = host.hello()
    assert hello.boot_id == (boot_id + 1) % 2**16
    hidden_by_a_boot_loader = not host.device.in_step and hello.reset_cause is UNKNOWN
    assert hello.reset_cause is m.ResetCause.EXTERNAL or hidden_by_a_boot_loader
    host.boot()
    assert host.refusal(m.Arm(SESSION)) == (m.NackCode.BAD_SESSION, 0)
    host.listen(200_000)
    assert host.talk.stream == []


@pytest.mark.requirement("SES-3")
@pytest.mark.parametrize(("stored", "boot_id"), [(0xFFFF, 1), (7, 8), (0xFFFE, 0)])
@pytest.mark.in_step("the boot counter cannot be set over a port")
def test_boot_counter_is_kept_in_eeprom(make_host, stored, boot_id):
    eeprom = EepromImage()
    eeprom.content[m.EEPROM_BOOT_COUNTER : m.EEPROM_BOOT_COUNTER + 2] = stored.to_bytes(2, "little")
    assert make_host(eeprom).hello().boot_id == boot_id


@pytest.mark.requirement("SES-3")
@pytest.mark.in_step("EEPROM cannot be seen over a port")
def test_no_cell_of_the_eeprom_is_written_at_every_reset(make_host):
    host = make_host()
    host.hello()  # once the start has been counted
    written = []
    for _ in range(2 * m.EEPROM_BOOT_COUNTERS):
        before = bytes(host.device.eeprom.content)
        boot_id = host.hello().boot_id
        host.reset()
        assert host.hello().boot_id == boot_id + 1
        after = host.device.eeprom.content
        written += [at for at in range(m.EEPROM_SIZE) if before[at] != after[at]]
    assert max(written.count(at) for at in set(written)) <= 2


def test_hello_is_answered_whatever_spec_the_host_has(listening):
    hello = listening.told(m.Hello(99, 12345), m.HelloReply)
    assert (hello.protocol_version, hello.spec_hash) == (m.PROTOCOL_VERSION, m.SPEC_HASH)
    assert (hello.axes, hello.max_payload, hello.tick_us) == (2, m.MAX_PAYLOAD.of(AXES), m.TICK_US)


@pytest.mark.requirement("TIM-5")
def test_session_cannot_be_opened_during_boot(in_boot):
    answer = in_boot.refusal(m.OpenSession(m.SPEC_HASH, SESSION))
    assert answer == (m.NackCode.BAD_STATE, m.State.BOOT)


@pytest.mark.requirement("TEL-1")
@pytest.mark.parametrize("period", [1, 2, 5])
def test_stream_reports_every_nth_tick_counting_from_zero(host, period):
    host.done(m.SetTelemetry(SESSION, period))
    tick = host.next_tick()
    stream = host.stream(20)
    assert [sequence for sequence, _ in stream] == list(range(20))
    assert [report.tick for _, report in stream] == [tick + period * (n + 1) for n in range(20)]


@pytest.mark.requirement("TEL-1")
def test_sequence_number_of_the_stream_wraps(host):
    host.done(m.SetTelemetry(SESSION, 1))
    assert [sequence for sequence, _ in host.stream(258)] == [*range(256), 0, 1]


@pytest.mark.requirement("TEL-1")
@pytest.mark.parametrize("end", [m.SetTelemetry(SESSION, 0), m.OpenSession(m.SPEC_HASH, SESSION)])
def test_stream_ends_on_request_and_with_a_new_session(host, end):
    host.done(m.SetTelemetry(SESSION, 1))
    assert host.stream(5)
    host.done(end)
    host.listen(200_000)
    assert host.talk.stream_since_answer == []


def test_telemetry_matches_get_state(armed):
    armed.done(m.SetTelemetry(SESSION, 1))
    armed.target(9000, -300)
    armed.go_past(armed.next_tick())
    report = armed.report()
    _, streamed = armed.talk.stream[-1]
    assert streamed == report
    assert report.flags & m.StatusFlags.CLAMPED
