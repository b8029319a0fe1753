"""LOG: the last faults, kept in EEPROM."""

from binascii import crc32

import pytest

from ccr_host.link import messages as m
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.device import AXES
from tests.conformance.host import SESSION

RECORD_TICKS = m.FaultRecord.SIZE
STOP_FITTED = m.Equipment((0,) * 16, 1, 0, 0)

pytestmark = pytest.mark.in_step("faults cannot be made at will over a port")


def record_at(host, place):
    if isinstance(host.ask(m.GetFaultRecord(place)), m.Nack):
        host.listen(5_000)  # until the byte is written
    return host.told(m.GetFaultRecord(place), m.FaultRecordReply).record


def records(host):
    """Those that were written to their end, oldest first."""
    host.wait_ticks(1)
    found = [record_at(host, place) for place in range(m.FAULT_LOG_RECORDS)]
    good = [record for record in found if crc32(record.pack()[:-4]) == record.check]
    return sorted(good, key=lambda record: record.number)


def make_fault(host):
    """Open the emergency stop; gives the number of the tick that sees it."""
    host.device.board.open_emergency_stop()
    tick = host.next_tick() + 1
    host.wait_ticks(1)
    host.device.board.open_emergency_stop(False)
    return tick


@pytest.fixture
def fitted(host):
    host.done(m.SetEquipment(SESSION, STOP_FITTED))
    return host


@pytest.mark.requirement("LOG-1")
def test_fault_is_logged_with_its_tick_its_boot_and_the_state_it_ended(fitted):
    assert records(fitted) == []
    fitted.arm()
    tick = make_fault(fitted)
    fitted.wait_ticks(RECORD_TICKS)
    (record,) = records(fitted)
    assert (record.number, record.fault, record.state) == (0, m.Fault.EMERGENCY_STOP, m.State.HOLD)
    assert (record.boot_id, record.tick) == (fitted.hello().boot_id, tick)
    fitted.wait_ticks(50)
    assert records(fitted) == [record], "once"


@pytest.mark.requirement("LOG-1")
def test_faults_after_a_reset_and_in_a_stopped_board_are_logged_too(fitted):
    fitted.done(m.Stop())
    fitted.wait_ticks(1)
    make_fault(fitted)
    fitted.wait_ticks(RECORD_TICKS)
    fitted.reset(m.ResetCause.WATCHDOG)
    fitted.boot()
    fitted.wait_ticks(RECORD_TICKS)
    kept = [(record.fault, record.state) for record in records(fitted)]
    assert kept == [
        (m.Fault.EMERGENCY_STOP, m.State.STOPPED),
        (m.Fault.WATCHDOG_RESET, m.State.BOOT),
    ]


@pytest.mark.requirement("LOG-1", "LOG-2")
def test_the_last_eight_faults_survive_resets_each_written_once(fitted):
    fitted.save()
    for _ in range(m.FAULT_LOG_RECORDS + 3):
        before = bytes(fitted.device.eeprom.content)
        make_fault(fitted)
        fitted.wait_ticks(RECORD_TICKS)
        after = fitted.device.eeprom.content
        written = {at for at in range(m.EEPROM_SIZE) if before[at] != after[at]}
        assert len({(at - m.FAULT_LOG_ADDRESS) // m.FaultRecord.SIZE for at in written}) == 1
        fitted.reset()
        fitted.boot()
        fitted.open_session()
    assert [record.number for record in records(fitted)] == list(range(3, 11))


@pytest.mark.requirement("LOG-1")
@pytest.mark.parametrize("newest", [0, 5, 7, 8, 0x7FFF, 0xFFFE, 0xFFFF])
def test_numbers_go_on_after_the_newest_record_also_when_they_wrap(make_host, newest):
    eeprom = EepromImage()
    for number in range(newest - 2, newest + 1):
        body = m.FaultRecord(number % 65536, 1, 4, 9, 1000, 0).pack()[:-4]
        at = m.FAULT_LOG_ADDRESS + number % m.FAULT_LOG_RECORDS * m.FaultRecord.SIZE
        eeprom.content[at : at + m.FaultRecord.SIZE] = body + crc32(body).to_bytes(4, "little")
    host = make_host(eeprom)
    host.reset(m.ResetCause.BROWN_OUT)
    host.boot()
    host.wait_ticks(RECORD_TICKS)
    number = (newest + 1) % 65536
    record = record_at(host, number % m.FAULT_LOG_RECORDS)
    assert (record.number, record.fault) == (number, m.Fault.BROWN_OUT_RESET)


@pytest.mark.requirement("LOG-2")
@pytest.mark.parametrize("ticks", range(RECORD_TICKS + 1))
def test_reset_while_a_record_is_written_costs_that_record_alone(fitted, ticks):
    fitted.save()
    make_fault(fitted)
    fitted.wait_ticks(RECORD_TICKS)
    fitted.done(m.ClearFault(SESSION))
    make_fault(fitted)
    if ticks:
        fitted.wait_ticks(ticks)
    fitted.reset()
    fitted.boot()
    fitted.open_session()
    whole = ticks >= RECORD_TICKS - 1
    assert [record.number for record in records(fitted)] == [0, 1][: 1 + whole]
    make_fault(fitted)
    fitted.wait_ticks(RECORD_TICKS)
    assert [record.number for record in records(fitted)] == [0, 1, 2][: 2 + whole]


@pytest.mark.requirement("LOG-1", "CFG-6")
def test_fault_during_a_save_waits_for_its_end(fitted):
    fitted.done(m.SaveConfig(SESSION))
    first = fitted.next_tick()
    fitted.wait_ticks(5)
    make_fault(fitted)
    assert (
        not fitted.report_of_tick(first + m.eeprom_slot_size(AXES)).flags
        & m.StatusFlags.EEPROM_BUSY
    )
    assert records(fitted) == []
    fitted.wait_ticks(RECORD_TICKS)
    assert [record.fault for record in records(fitted)] == [m.Fault.EMERGENCY_STOP]


@pytest.mark.requirement("LOG-1")
def test_record_is_refused_only_while_a_byte_is_being_written_or_out_of_range(fitted):
    assert fitted.refusal(m.GetFaultRecord(8)) == (m.NackCode.OUT_OF_RANGE, 0)
    make_fault(fitted)
    for tick in range(RECORD_TICKS):
        answer = fitted.ask(m.GetFaultRecord(0))
        if isinstance(answer, m.Nack):
            assert answer.code is m.NackCode.BUSY
        fitted.wait_ticks(1)
        assert tick < RECORD_TICKS
    assert record_at(fitted, 0).fault == m.Fault.EMERGENCY_STOP
