"""SES and TEL."""

import pytest

from ccr_host.emulator.eeprom import EepromImage
from ccr_host.link import messages as m

SESSION = 0x5E55


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
def test_nothing_that_changes_something_works_without_a_session(make_host):
    host = make_host()
    host.boot()
    for request in requests_with_a_session(0) + requests_with_a_session(SESSION):
        assert host.refusal(request) == (m.NackCode.BAD_SESSION, 0)
    assert not host.report().flags & m.StatusFlags.SESSION_OPEN


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
@pytest.mark.in_step
def test_reset_closes_the_session_ends_telemetry_and_counts_up(host):
    boot_id = host.told(m.Hello(1, m.SPEC_HASH), m.HelloReply).boot_id
    host.done(m.SetTelemetry(SESSION, 1))
    host.device.reset(m.ResetCause.EXTERNAL)
    hello = host.told(m.Hello(1, m.SPEC_HASH), m.HelloReply)
    assert hello.boot_id == boot_id + 1
    assert hello.reset_cause is m.ResetCause.EXTERNAL
    host.boot()
    assert host.refusal(m.Arm(SESSION)) == (m.NackCode.BAD_SESSION, 0)
    host.telemetry.clear()
    host.listen(200_000)
    assert host.telemetry == []


@pytest.mark.requirement("SES-3")
@pytest.mark.parametrize(("stored", "boot_id"), [(0xFFFF, 1), (7, 8), (0xFFFE, 0xFFFF)])
@pytest.mark.in_step
def test_boot_counter_is_kept_in_eeprom(make_host, stored, boot_id):
    eeprom = EepromImage()
    eeprom.content[m.EEPROM_BOOT_COUNTER : m.EEPROM_BOOT_COUNTER + 2] = stored.to_bytes(2, "little")
    host = make_host(eeprom)
    assert host.told(m.Hello(1, m.SPEC_HASH), m.HelloReply).boot_id == boot_id


def test_hello_is_answered_whatever_spec_the_host_has(make_host):
    host = make_host()
    hello = host.told(m.Hello(99, 12345), m.HelloReply)
    assert (hello.protocol_version, hello.spec_hash) == (m.PROTOCOL_VERSION, m.SPEC_HASH)
    assert (hello.axes, hello.max_payload, hello.tick_us) == (2, m.MAX_PAYLOAD, m.TICK_US)


@pytest.mark.in_step
def test_session_cannot_be_opened_during_boot(make_host):
    answer = make_host().refusal(m.OpenSession(m.SPEC_HASH, SESSION))
    assert answer == (m.NackCode.BAD_STATE, m.State.BOOT)


@pytest.mark.requirement("TEL-1")
@pytest.mark.parametrize("period", [1, 2, 5])
@pytest.mark.in_step
def test_stream_reports_every_nth_tick_counting_from_zero(host, period):
    host.to_after_tick(host.next_tick())
    host.done(m.SetTelemetry(SESSION, period))
    tick = host.next_tick()
    host.to_after_tick(tick + 20 * period - 1)
    host.listen(5_000)
    assert [sequence for sequence, _ in host.telemetry] == list(range(20))
    ticks = [report.tick for _, report in host.telemetry]
    assert ticks == [tick + period * (n + 1) for n in range(20)]


@pytest.mark.requirement("TEL-1")
@pytest.mark.in_step
def test_sequence_number_of_the_stream_wraps(host):
    host.done(m.SetTelemetry(SESSION, 1))
    host.listen(258 * m.TICK_US)
    assert [sequence for sequence, _ in host.telemetry][:258] == [*range(256), 0, 1]


@pytest.mark.requirement("TEL-1")
@pytest.mark.parametrize("end", [m.SetTelemetry(SESSION, 0), m.OpenSession(m.SPEC_HASH, SESSION)])
def test_stream_ends_on_request_and_with_a_new_session(host, end):
    host.done(m.SetTelemetry(SESSION, 1))
    host.listen(100_000)
    assert host.telemetry
    host.done(end)
    host.telemetry.clear()
    host.listen(200_000)
    assert host.telemetry == []


def test_telemetry_tells_the_same_as_get_state(armed):
    armed.done(m.SetTelemetry(SESSION, 1))
    armed.target(9000, -300)
    report = armed.report_of_tick(armed.next_tick())
    assert armed.telemetry[-1][1] == report
    assert report.flags & m.StatusFlags.CLAMPED
