"""CFG: groups and EEPROM."""

from binascii import crc32

import pytest

from ccr_host.link import messages as m
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.device import AXES

SESSION = 0x5E55
SLEWS = [m.Slew((100 + n, 200 + n)) for n in range(5)]


def slew(host):
    return host.config().slew


def status(host):
    return host.hello().eeprom_status


def restart(host):
    host.reset()
    host.boot()
    host.open_session()


def saved_twice(host):
    """Slot A holds SLEWS[0], slot B, the newer, SLEWS[1]."""
    for value in SLEWS[:2]:
        host.done(m.SetSlew(SESSION, value))
        host.save()


@pytest.mark.requirement("CFG-1")
def test_group_with_one_bad_field_is_not_taken_at_all(host):
    bad = m.Calibration((3000, 3000), (900, 900), (1000, 1000), (5000, 5001))
    before = host.told(m.GetCalibration(), m.CalibrationReply)
    assert host.refusal(m.SetCalibration(SESSION, bad)) == (m.NackCode.OUT_OF_RANGE, 4)
    assert host.told(m.GetCalibration(), m.CalibrationReply) == before


def test_setpoint_is_clamped_to_new_limits(armed):
    armed.target(4000, 3000)
    armed.wait_ticks(10)
    armed.done(m.Stop())
    armed.done(m.SetLimits(SESSION, m.Limits((-1000, -1000), (1000, 1000), (0, 0))))
    assert armed.report_of_tick(armed.next_tick()).setpoint_cdeg == (1000, 1000)


@pytest.mark.requirement("CFG-1")
def test_missing_groups_read_as_zeros(unconfigured):
    assert slew(unconfigured) == m.Slew((0, 0))


@pytest.mark.requirement("CFG-2")
@pytest.mark.usefixtures("may_save")
def test_saved_configuration_is_in_use_after_a_reset(host):
    config = host.config()
    assert host.report().flags & m.StatusFlags.UNSAVED
    host.save()
    assert not host.report().flags & m.StatusFlags.UNSAVED
    assert host.counters().saves == 1
    restart(host)
    assert status(host) is m.EepromStatus.LOADED
    assert host.config() == config
    assert host.report().flags & m.StatusFlags.CONFIGURED
    host.arm()


def test_unsaved_configuration_is_lost_with_a_reset(started):
    started.boot()
    started.open_session()
    saved = started.config()
    started.configure(slew=SLEWS[0] if saved.slew != SLEWS[0] else SLEWS[1])
    assert started.config() != saved
    started.reset()
    assert started.config() == saved


def set_generation(eeprom, address, generation):
    body = bytearray(eeprom.content[address : address + m.eeprom_slot_size(AXES) - 4])
    assert body[:3] == m.EEPROM_MAGIC.to_bytes(2, "little") + bytes([m.EEPROM_LAYOUT])
    body[3:5] = generation.to_bytes(2, "little")
    eeprom.content[address : address + m.eeprom_slot_size(AXES)] = body + crc32(body).to_bytes(
        4, "little"
    )


@pytest.mark.requirement("CFG-2")
@pytest.mark.in_step("the EEPROM cannot be written over a port, but by saving")
def test_newest_of_many_saves_is_loaded_also_when_the_generation_wraps(host):
    saved_twice(host)
    set_generation(host.device.eeprom, m.EEPROM_SLOT_A, 0xFFFD)
    set_generation(host.device.eeprom, m.EEPROM_SLOT_B.of(AXES), 0xFFFE)
    restart(host)
    for value in SLEWS:
        host.done(m.SetSlew(SESSION, value))
        host.save()
        restart(host)
        assert slew(host) == value


@pytest.mark.requirement("CFG-3", "CFG-4")
@pytest.mark.parametrize("ticks", [8, 24])
@pytest.mark.usefixtures("may_save")
def test_reset_in_the_middle_of_a_save_leaves_the_one_before(host, ticks):
    saved_twice(host)
    host.done(m.SetSlew(SESSION, SLEWS[2]))
    host.done(m.SaveConfig(SESSION))
    host.wait_ticks(ticks)
    restart(host)
    assert status(host) is m.EepromStatus.ONE_SLOT_BAD, "the reset came while it was saving"
    assert slew(host) == SLEWS[1]
    host.arm()


@pytest.mark.requirement("CFG-3")
@pytest.mark.parametrize("first", ["erased", "older"])
@pytest.mark.in_step("a port's reset does not come at a chosen byte")
def test_power_cut_at_any_byte_of_a_save_leaves_the_one_before(make_host, host, first):
    host.done(m.SetSlew(SESSION, SLEWS[0]))
    host.save()
    if first == "older":
        host.done(m.SetSlew(SESSION, SLEWS[1]))
        host.save()
    before = slew(host)
    image = bytes(host.device.eeprom.content)
    for written in range(m.eeprom_slot_size(AXES) + 1):
        cut = make_host(EepromImage(image))
        cut.boot()
        cut.open_session()
        cut.done(m.SetSlew(SESSION, SLEWS[2]))
        cut.done(m.SaveConfig(SESSION))
        if written:
            cut.wait_ticks(written)
        cut.reset(m.ResetCause.POWER_ON)
        finished = written == m.eeprom_slot_size(AXES)
        assert slew(cut) == (SLEWS[2] if finished else before)
        cut.boot()
        cut.open_session()
        cut.done(m.Arm(SESSION))


@pytest.mark.requirement("CFG-4")
@pytest.mark.parametrize(
    ("corrupt", "expected", "loaded"),
    [
        ([], m.EepromStatus.LOADED, SLEWS[1]),
        ([m.EEPROM_SLOT_A], m.EepromStatus.ONE_SLOT_BAD, SLEWS[1]),
        ([m.EEPROM_SLOT_B.of(AXES)], m.EepromStatus.ONE_SLOT_BAD, SLEWS[0]),
        ([m.EEPROM_SLOT_A, m.EEPROM_SLOT_B.of(AXES)], m.EepromStatus.BOTH_BAD, m.Slew((0, 0))),
    ],
)
@pytest.mark.parametrize("offset", [0, 2, 20, m.eeprom_slot_size(AXES) - 1])
@pytest.mark.in_step("slots cannot be spoilt over a port")
def test_corrupt_slots_are_reported_and_not_used(host, corrupt, expected, loaded, offset):
    saved_twice(host)
    for address in corrupt:
        host.device.eeprom.content[address + offset] ^= 0x01
    restart(host)
    assert status(host) is expected
    assert slew(host) == loaded
    if expected is m.EepromStatus.BOTH_BAD:
        assert host.refusal(m.Arm(SESSION))[0] is m.NackCode.NOT_CONFIGURED
        host.done(m.SetEquipment(SESSION, m.Equipment((0,) * 16, 0, 0, 0)))
    host.configure()
    host.save()
    restart(host)
    host.arm()


@pytest.mark.requirement("CFG-5", "CFG-6")
@pytest.mark.usefixtures("may_save")
def test_while_saving_arm_and_configuring_have_to_wait(host):
    calibration = host.told(m.GetCalibration(), m.CalibrationReply).calibration
    limits = host.told(m.GetLimits(), m.LimitsReply).limits
    host.done(m.SaveConfig(SESSION))
    tick = host.next_tick()
    assert host.report().flags & m.StatusFlags.EEPROM_BUSY
    for request in (
        m.Arm(SESSION),
        m.SaveConfig(SESSION),
        m.SetLimits(SESSION, limits),
        m.SetSlew(SESSION, SLEWS[0]),
        m.SetWatchdog(SESSION, m.Watchdog(100, 100, 100)),
        m.SetCalibration(SESSION, calibration),
    ):
        assert host.refusal(request) == (m.NackCode.BUSY, 0)
    last = tick + m.eeprom_slot_size(AXES)
    assert host.report_of_tick(last - 1).flags & m.StatusFlags.EEPROM_BUSY
    assert not host.report_of_tick(last).flags & m.StatusFlags.EEPROM_BUSY
    host.arm()


@pytest.mark.requirement("CFG-6")
@pytest.mark.in_step("EEPROM cells cannot be worn out over a port")
def test_byte_that_does_not_keep_its_value_is_a_fault(make_host):
    host = make_host(EepromImage(worn_out=frozenset({m.EEPROM_SLOT_A + 6})))
    host.boot()
    host.open_session()
    host.configure()
    host.done(m.SaveConfig(SESSION))
    report = host.report_of_tick(host.next_tick() + 10)
    assert (report.state, report.fault) == (m.State.FAULT, m.Fault.EEPROM_FAILED)
    assert not report.flags & m.StatusFlags.EEPROM_BUSY
    assert report.flags & m.StatusFlags.UNSAVED
