"""EST: the emergency stop; SUP: the servos' supply; CFG: name and equipment of a board."""

from dataclasses import replace

import pytest

from ccr_host.link import messages as m
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.device import AXES
from tests.conformance.host import CALIBRATION, LIMITS, SESSION, SLEW, WATCHDOG

NOTHING = m.Equipment((0,) * 16, 0, 0, 0)
NAMED = m.Equipment(tuple(b"left arm".ljust(16, b"\0")), 0, 100, 50)
FITTED = m.Equipment((0,) * 16, 1, 0, 0)
REACTION_US = 22_000
OF_LAYOUT_1 = bytes.fromhex(
    "52cc010000ccde90e834217017000000005802f401e80364006400b80b1c0cd00794f8e803b0048813c012ee8deae4"
)
"""A slot saved by the firmware before layout 2: LIMITS, SLEW, WATCHDOG and CALIBRATION."""

pytestmark = pytest.mark.in_step("a port's board keeps its own equipment")


def equipment(host):
    return host.told(m.GetEquipment(), m.EquipmentReply).equipment


def restart(host):
    host.reset()
    host.boot()
    host.open_session()


def latch(host):
    report = host.report_of_tick(host.next_tick())
    return report.state, report.fault


EMERGENCY = (m.State.FAULT, m.Fault.EMERGENCY_STOP)


@pytest.fixture
def fitted(host):
    """A host of a board with an emergency stop that can be armed."""
    host.done(m.SetEquipment(SESSION, FITTED))
    return host


@pytest.mark.requirement("EST-1")
@pytest.mark.parametrize("state", ["arming", "hold", "active", "relaxing", "disarming"])
@pytest.mark.parametrize("after_frame_began_us", [4_000, 17_000, 17_990, 19_000])
def test_opening_the_emergency_stop_ends_the_pulses_within_22_ms(
    fitted, state, after_frame_began_us
):
    device = fitted.device
    fitted.done(m.Arm(SESSION))
    if state != "arming":
        fitted.wait_for(m.State.HOLD)
    if state in ("active", "disarming"):
        fitted.target(8000, 5000)
    if state == "disarming":
        fitted.wait_ticks(5)
        fitted.done(m.Disarm(SESSION))
    if state == "relaxing":
        fitted.target(8000, 5000, validity_ms=100)
        fitted.wait_for(m.State.RELAXING)
    fitted.wait_ticks(2)
    assert fitted.state() is m.State[state.upper()]
    frame = device.since_reset_us() // m.TICK_US + 1
    assert device.pulses_in_frame(frame)[0] > 0
    opened_us = frame * m.TICK_US + after_frame_began_us
    device.advance_to(opened_us)
    device.board.open_emergency_stop()
    first_us = [
        at for at in range(frame + 1, frame + 4) if at * m.TICK_US > opened_us + REACTION_US
    ]
    device.advance_to(first_us[0] * m.TICK_US - 1)
    assert not device.board.servo_supply_on
    assert {device.pulses_in_frame(at) for at in range(first_us[0], first_us[0] + 5)} == {(0, 0)}
    assert latch(fitted) == EMERGENCY


@pytest.mark.requirement("EST-1")
@pytest.mark.parametrize("when", ["disarmed", "boot"])
def test_open_emergency_stop_keeps_the_board_from_being_armed(fitted, when):
    if when == "boot":
        fitted.save()
    fitted.device.board.open_emergency_stop()
    if when == "boot":
        fitted.reset()
        for _ in range(m.BOOT_TICKS):
            assert latch(fitted) == (m.State.BOOT, m.Fault.NONE)
    assert latch(fitted) == EMERGENCY
    fitted.open_session()
    assert fitted.refusal(m.Arm(SESSION)) == (m.NackCode.BAD_STATE, m.State.FAULT)


@pytest.mark.requirement("EST-1", "FLT-1")
def test_emergency_stop_is_recorded_in_a_stopped_board_and_replaces_no_fault(fitted):
    fitted.done(m.Stop())
    fitted.device.board.open_emergency_stop()
    assert latch(fitted) == (m.State.STOPPED, m.Fault.EMERGENCY_STOP)
    fitted.reset(m.ResetCause.WATCHDOG)
    fitted.boot()
    assert latch(fitted) == (m.State.FAULT, m.Fault.WATCHDOG_RESET)


@pytest.mark.requirement("EST-1")
def test_without_an_emergency_stop_its_input_means_nothing(host):
    host.device.board.open_emergency_stop()
    host.arm()
    assert latch(host) == (m.State.HOLD, m.Fault.NONE)


@pytest.mark.requirement("EST-2")
@pytest.mark.parametrize("latched_by", ["itself", "stop"])
def test_latch_is_not_cleared_while_the_emergency_stop_is_open(fitted, latched_by):
    fitted.arm()
    if latched_by == "stop":
        fitted.done(m.Stop())
    fitted.device.board.open_emergency_stop()
    assert latch(fitted)[1] is m.Fault.EMERGENCY_STOP
    for _ in range(3):
        assert fitted.refusal(m.ClearFault(SESSION)) == (m.NackCode.EMERGENCY_STOP_OPEN, 0)
        fitted.wait_ticks(30)
    fitted.device.board.open_emergency_stop(False)
    assert latch(fitted)[1] is m.Fault.EMERGENCY_STOP, "closing it clears nothing"
    fitted.done(m.ClearFault(SESSION))
    assert latch(fitted) == (m.State.DISARMED, m.Fault.NONE)
    fitted.arm()


@pytest.mark.requirement("EST-2")
def test_emergency_stop_that_is_not_there_can_be_taken_back(fitted):
    fitted.device.board.open_emergency_stop()
    assert latch(fitted) == EMERGENCY
    fitted.done(m.SetEquipment(SESSION, NOTHING))
    fitted.done(m.ClearFault(SESSION))
    fitted.arm()


@pytest.mark.requirement("CFG-2")
@pytest.mark.parametrize("wanted", [NAMED, FITTED])
def test_name_and_equipment_survive_a_reset_once_saved(host, wanted):
    host.done(m.SetEquipment(SESSION, wanted))
    assert host.report().flags & m.StatusFlags.UNSAVED
    host.save()
    restart(host)
    assert equipment(host) == wanted
    host.arm()


@pytest.mark.requirement("CFG-7")
@pytest.mark.parametrize("address", [m.EEPROM_SLOT_A, m.EEPROM_SLOT_B.of(AXES)])
def test_board_calibrated_with_the_former_firmware_keeps_its_calibration(make_host, address):
    eeprom = EepromImage()
    eeprom.content[address : address + len(OF_LAYOUT_1)] = OF_LAYOUT_1
    host = make_host(eeprom)
    host.boot()
    host.open_session()
    assert host.hello().eeprom_status is m.EepromStatus.LOADED
    config = host.config()
    assert (config.limits, config.slew) == (LIMITS, SLEW)
    assert (config.watchdog, config.calibration) == (WATCHDOG, CALIBRATION)
    assert equipment(host) == NOTHING
    host.done(m.SetEquipment(SESSION, NAMED))
    host.save()
    kept = eeprom.content[address : address + len(OF_LAYOUT_1)]
    assert kept == OF_LAYOUT_1, "a save goes to the other slot"
    restart(host)
    assert (host.config(), equipment(host)) == (config, NAMED)
    host.save()
    restart(host)
    assert (host.config(), equipment(host)) == (config, NAMED)
    host.arm()


@pytest.mark.requirement("CFG-4", "CFG-7")
@pytest.mark.parametrize("offset", [0, 1, 2, 5, 30, 42, 43, 46])
def test_damaged_slot_of_the_former_layout_is_corrupt(make_host, offset):
    eeprom = EepromImage()
    eeprom.content[: len(OF_LAYOUT_1)] = OF_LAYOUT_1
    eeprom.content[offset] ^= 0x10
    host = make_host(eeprom)
    assert host.hello().eeprom_status is m.EepromStatus.BOTH_BAD


@pytest.mark.requirement("CFG-8")
def test_board_that_may_have_lost_its_emergency_stop_is_not_armed(make_host):
    eeprom = EepromImage()
    eeprom.content[0] = 0
    host = make_host(eeprom)
    host.boot()
    host.open_session()
    host.configure()
    assert not host.report().flags & m.StatusFlags.CONFIGURED
    expected = (m.NackCode.NOT_CONFIGURED, m.ConfigGroups.EQUIPMENT)
    assert host.refusal(m.Arm(SESSION)) == expected
    assert host.refusal(m.SaveConfig(SESSION)) == expected
    host.done(m.SetEquipment(SESSION, NOTHING))
    host.arm()


@pytest.mark.requirement("CFG-8")
def test_new_board_has_no_equipment_and_needs_none(unconfigured):
    assert equipment(unconfigured) == NOTHING
    code, missing = unconfigured.refusal(m.Arm(SESSION))
    assert code is m.NackCode.NOT_CONFIGURED
    assert not m.ConfigGroups(missing) & m.ConfigGroups.EQUIPMENT


def test_equipment_is_set_whole_or_not_and_not_while_saving_or_armed(host):
    host.done(m.SetEquipment(SESSION, NAMED))
    bad = replace(FITTED, emergency_stop=2)
    assert host.refusal(m.SetEquipment(SESSION, bad)) == (m.NackCode.OUT_OF_RANGE, 2)
    assert equipment(host) == NAMED
    host.done(m.SaveConfig(SESSION))
    assert host.refusal(m.SetEquipment(SESSION, FITTED)) == (m.NackCode.BUSY, 0)
    host.wait_ticks(m.eeprom_slot_size(AXES) + 1)
    host.arm()
    assert host.refusal(m.SetEquipment(SESSION, FITTED)) == (m.NackCode.BAD_STATE, m.State.HOLD)


MEASURED = m.Equipment((0,) * 16, 0, supply_full_dv=100, supply_min_dv=50)
"""A divider by two, and at least 5 V."""
LOW = (m.State.FAULT, m.Fault.SUPPLY_LOW)


def set_supply(host, volts):
    host.device.board.set_supply_pin_mv(round(1000 * volts / 2) + 10)


@pytest.mark.requirement("SUP-2")
@pytest.mark.parametrize("volts", [0, 4.9, 5.0, 7.4, 10.0])
def test_report_contains_the_servo_supply(host, volts):
    assert host.report().supply_dv == 0
    set_supply(host, volts)
    host.done(m.SetEquipment(SESSION, MEASURED))
    host.wait_ticks(2)
    assert abs(host.report().supply_dv - volts * 10) <= 1
    host.done(m.SetEquipment(SESSION, NOTHING))
    host.wait_ticks(1)
    assert host.report().supply_dv == 0


@pytest.mark.requirement("SUP-3")
def test_supply_that_stays_too_low_is_a_fault_and_a_short_dip_is_not(host):
    host.done(m.SetEquipment(SESSION, MEASURED))
    set_supply(host, 4)
    host.wait_ticks(2 * m.SAG_TICKS)
    assert latch(host) == (m.State.DISARMED, m.Fault.NONE), "nothing is to be supplied yet"
    set_supply(host, 6)
    host.arm()
    for _ in range(3):
        set_supply(host, 4)
        host.wait_ticks(m.SAG_TICKS - 1)
        set_supply(host, 6)
        host.wait_ticks(1)
    assert latch(host) == (m.State.HOLD, m.Fault.NONE)
    set_supply(host, 4)
    first = host.next_tick()
    for tick in range(first, first + m.SAG_TICKS - 1):
        assert host.report_of_tick(tick).state is m.State.HOLD
    assert host.pulses_of_tick(first + m.SAG_TICKS - 2) != (0, 0)
    assert latch(host) == LOW
    assert host.pulses_of_tick(first + m.SAG_TICKS) == (0, 0)
    assert not host.device.board.servo_supply_on


@pytest.mark.requirement("SUP-3")
@pytest.mark.parametrize("supply_on_after_ticks", [m.SAG_TICKS - 2, None])
def test_supply_has_some_ticks_to_come_up_after_arming(host, supply_on_after_ticks):
    host.done(m.SetEquipment(SESSION, MEASURED))
    set_supply(host, 0)
    host.wait_ticks(1)
    host.done(m.Arm(SESSION))
    if supply_on_after_ticks is not None:
        host.wait_ticks(supply_on_after_ticks)
        set_supply(host, 6)
    host.wait_ticks(2 * m.SAG_TICKS)
    assert (latch(host) == LOW) == (supply_on_after_ticks is None)


@pytest.mark.requirement("SUP-3")
@pytest.mark.parametrize(("full_dv", "min_dv"), [(0, 50), (100, 0)])
def test_supply_is_never_too_low_where_none_is_measured_or_asked_for(host, full_dv, min_dv):
    host.done(
        m.SetEquipment(SESSION, replace(MEASURED, supply_full_dv=full_dv, supply_min_dv=min_dv))
    )
    set_supply(host, 0)
    host.arm()
    host.wait_ticks(2 * m.SAG_TICKS)
    assert host.report().fault is m.Fault.NONE
