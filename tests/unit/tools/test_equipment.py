"""Setting and using the name and equipment of a board."""

from binascii import crc32
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from ccr_host.core.clock import RealClock, VirtualClock
from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client
from ccr_host.link.device_errors import BoardFaultError, RequestRefusedError, WrongBoardError
from ccr_host.link.messages import (
    FAULT_LOG_ADDRESS,
    FAULT_LOG_RECORDS,
    TICK_US,
    Equipment,
    FaultRecord,
    ResetCause,
    State,
)
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions
from ccr_host.sim.board.board import SerialLine, UnoEmulator
from ccr_host.sim.board.eeprom import EepromImage
from ccr_host.sim.serving.ports import TcpPort
from ccr_host.sim.serving.server import BoardServer
from ccr_host.tools.checks import Severity
from ccr_host.tools.doctor import check_board
from ccr_host.tools.equipment import (
    EquipmentChange,
    change_equipment,
    equipment_text,
    set_equipment,
)


class Bench(UnoEmulator):
    """A board with a line on a clock."""

    def __init__(self) -> None:
        self.image = EepromImage()
        super().__init__(self.image)
        self.clock = VirtualClock()
        self.line = SerialLine(self)
        self.clock.attach(self.line)


@contextmanager
def connected(board: Bench) -> Iterator[Client]:
    with Client(board.line, board.clock, 1) as client:
        client.connect()
        yield client


def change(
    board: Bench,
    *,
    board_name: str | None = None,
    emergency_stop: bool | None = None,
    supply_divider: float | None = None,
    supply_min_v: float | None = None,
) -> str:
    wanted = EquipmentChange(board_name, emergency_stop, supply_divider, supply_min_v)
    with connected(board) as client:
        return equipment_text(change_equipment(client, Description(), wanted))


def test_each_change_is_stored_and_leaves_the_rest_unchanged() -> None:
    board = Bench()
    assert (
        change(board, board_name="left arm")
        == "named left arm, no emergency stop, supply not measured"
    )
    assert (
        change(board, emergency_stop=True)
        == "named left arm, emergency stop fitted, supply not measured"
    )
    board.reset(ResetCause.POWER_ON)
    with connected(board) as client:
        assert (
            equipment_text(client.read_equipment())
            == "named left arm, emergency stop fitted, supply not measured"
        )
    assert (
        change(board, board_name="", emergency_stop=False)
        == "no name, no emergency stop, supply not measured"
    )


def test_telling_a_calibrated_board_its_name_leaves_its_calibration() -> None:
    board = Bench()
    calibrated = Description.model_validate({"servo": {"neutral_pulse_us": [1520, 1490]}})
    with connected(board) as client:
        client.configure(board_config(calibrated))
        client.save_config()
    board.reset(ResetCause.POWER_ON)
    change(board, board_name="arm 2")
    board.reset(ResetCause.POWER_ON)
    with connected(board) as client:
        assert client.read_config() == board_config(calibrated)


@pytest.mark.parametrize("name", ["a name of 17 chars", "größe", "tab\t", " arm"])
def test_name_that_the_board_cannot_keep_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="printable ASCII characters"):
        change(Bench(), board_name=name)


def test_pressed_emergency_stop_ends_a_run_with_its_fault_and_clearing_waits_for_it() -> None:
    board = Bench()
    change(board, emergency_stop=True)
    with connected(board) as client:
        client.configure(board_config(Description()))
        client.arm()
        board.open_emergency_stop()
        with pytest.raises(BoardFaultError, match="emergency stop"):
            client.disarm()
        with pytest.raises(RequestRefusedError, match="release the switch"):
            client.clear_fault()
        board.open_emergency_stop(False)
        client.clear_fault()
        assert client.read_state().state is State.DISARMED


def test_board_with_a_corrupt_eeprom_reports_what_must_be_configured() -> None:
    board = Bench()
    change(board, emergency_stop=True)
    board.image.content[0] = 0
    board.reset(ResetCause.POWER_ON)
    with connected(board) as client:
        client.configure(board_config(Description()))
        with pytest.raises(RequestRefusedError, match="--emergency-stop"):
            client.arm()
    change(board, emergency_stop=True)
    with connected(board) as client:
        client.arm()


def test_doctor_reports_equipment_and_a_name_other_than_described() -> None:
    board = Bench()
    change(board, board_name="left arm")
    found = {}
    for wanted in ("left arm", "right arm"):
        robot = Description.model_validate({"robot": {"board_name": wanted}})
        with connected(board) as client:
            found[wanted] = {f.subject: f for f in check_board(client, board.clock, robot)}
    assert "named left arm" in found["left arm"]["equipment"].text
    assert "board's name" not in found["left arm"]
    assert found["right arm"]["board's name"].severity is Severity.FAILURE
    assert found["right arm"]["board's name"].exit_status == 3


@pytest.mark.parametrize("name", ["", "left arm"])
def test_run_on_another_board_than_described_is_refused_before_arming(name: str) -> None:
    bench = Bench()
    if name:
        change(bench, board_name=name)
    board = UnoEmulator(bench.image)
    server = BoardServer(SerialLine(board), TcpPort(0), RealClock(), boot_loader_us=0)
    with server:
        options = RigOptions(device=server.uri, overrides=("robot.board_name=right arm",))
        expected = f"named {name or 'nothing'}, robot.board_name is right arm"
        with (
            pytest.raises(WrongBoardError, match=expected),
            open_rig(options, options.description(), Observers()),
        ):
            pass
    assert board.state in (State.BOOT, State.DISARMED)


def test_simulated_board_has_whatever_name_is_described() -> None:
    options = RigOptions(overrides=("robot.board_name=right arm",))
    with open_rig(options, options.description(), Observers()) as rig:
        rig.client.arm()


def test_supply_is_reported_in_volts_and_checked_by_the_doctor() -> None:
    board = Bench()
    told = change(board, supply_divider=2, supply_min_v=5.5)
    assert told.endswith("supply measured up to 10 V, a fault below 5.5 V")
    for pin_mv, severity in ((3010, Severity.GOOD), (2500, Severity.WARNING)):
        board.set_supply_pin_mv(pin_mv)
        board.clock.sleep_until_us(board.clock.now_us() + 2 * TICK_US)
        with connected(board) as client:
            findings = {f.subject: f for f in check_board(client, board.clock, Description())}
        assert findings["servo supply"].severity is severity
    assert findings["servo supply"].text == "5 V"


@pytest.mark.parametrize(
    ("divider", "least_v"), [(5.2, None), (-1, None), (float("nan"), None), (2, 26), (2, 10.1)]
)
def test_supply_that_the_board_cannot_measure_is_refused(
    divider: float, least_v: float | None
) -> None:
    with pytest.raises(ConfigError):
        change(Bench(), supply_divider=divider, supply_min_v=least_v)


def test_doctor_lists_the_last_faults_newest_first() -> None:
    board = Bench()
    change(board, emergency_stop=True)
    for voltage_mv in (3000, 0):
        with connected(board) as client:
            client.set_equipment(Equipment((0,) * 16, 1, 100, 50 if not voltage_mv else 0))
            board.set_supply_pin_mv(voltage_mv)
            client.configure(board_config(Description()))
            try:
                client.arm()
                board.open_emergency_stop()
                client.disarm()
            except BoardFaultError:
                board.open_emergency_stop(False)
                board.clock.sleep_until_us(board.clock.now_us() + 30 * TICK_US)
                client.clear_fault()
    board.reset(ResetCause.POWER_ON)
    with connected(board) as client:
        found = {f.subject: f for f in check_board(client, board.clock, Description())}
    newest, older = found["last faults"].text.split("; ")
    assert newest.startswith("supply_low in arming,")
    assert older.startswith("emergency_stop in hold,")
    assert newest.endswith("s after the start of boot 1")


def test_fault_log_is_read_in_order_when_its_numbers_wrap() -> None:
    board = Bench()
    for number in (65534, 65535, 0, 1):
        body = FaultRecord(number, 1, 4, 9, 1000, 0).pack()[:-4]
        at = FAULT_LOG_ADDRESS + number % FAULT_LOG_RECORDS * FaultRecord.SIZE
        record = body + crc32(body).to_bytes(4, "little")
        board.image.content[at : at + FaultRecord.SIZE] = record
    with connected(board) as client:
        assert [record.number for record in client.read_fault_log()] == [1, 0, 65535, 65534]


@pytest.mark.long
@pytest.mark.parametrize("is_open", [False, True])
def test_emergency_stop_that_is_open_when_it_is_configured_is_reported(
    is_open: bool,
) -> None:
    board = UnoEmulator()
    board.open_emergency_stop(is_open)
    server = BoardServer(SerialLine(board), TcpPort(0), RealClock(), boot_loader_us=0)
    with server:
        told = set_equipment(RigOptions(device=server.uri), EquipmentChange(emergency_stop=True))
    assert ("now open" in told) == is_open
