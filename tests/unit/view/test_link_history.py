import math

from ccr_host.link.framing import encode_frame
from ccr_host.link.messages import (
    Fault,
    GetState,
    HelloReply,
    SetTarget,
    State,
    StateReport,
    StatusFlags,
    TargetReply,
    Telemetry,
)
from ccr_host.view.history import LinkHistory


def report(state: State = State.ACTIVE, link_errors: int = 0) -> StateReport:
    flags = StatusFlags(0)
    return StateReport(
        1, state, Fault.NONE, flags, 0, 0, (0, 0), (9000, -4500), (3000, 2000), link_errors, 0, 0
    )


class Wire:
    """Lets a history see messages."""

    def __init__(self) -> None:
        self.history = LinkHistory()

    def sent(self, time_us: int, sequence: int, message: SetTarget | GetState) -> None:
        data = encode_frame(message.ID, sequence, message.pack())
        self.history.frame("sent", time_us, data)

    def received(self, time_us: int, sequence: int, message: Telemetry | TargetReply) -> None:
        inner = message.report if isinstance(message, Telemetry) else message
        data = encode_frame(message.ID, sequence, inner.pack())
        self.history.frame("received", time_us, data)


TARGET = SetTarget(1, (0, 0), 0, 200)
REPLY = TargetReply(State.ACTIVE, StatusFlags(0), (0, 0))


def test_round_trips_go_from_a_request_to_its_own_reply() -> None:
    wire = Wire()
    wire.sent(1000, 7, TARGET)
    wire.sent(5000, 8, TARGET)
    wire.received(6000, 8, REPLY)
    wire.received(9000, 7, REPLY)
    wire.received(9500, 7, REPLY)
    assert wire.history.round_trips_until(1e9).tolist() == [[6000, 1000], [9000, 8000]]


def test_a_repeated_request_is_a_retry_and_gives_no_round_trip() -> None:
    wire = Wire()
    wire.sent(0, 1, GetState())
    wire.sent(100_000, 1, GetState())
    wire.received(101_000, 2, Telemetry(report()))
    health = wire.history.health_at(1e9)
    assert health is not None
    assert (health.sent, health.received, health.retries) == (2, 1, 1)
    assert math.isnan(health.round_trip_us)


def test_gaps_in_the_telemetry_are_reports_lost_also_where_the_count_wraps() -> None:
    wire = Wire()
    for time_us, sequence in ((0, 253), (100_000, 254), (200_000, 2), (300_000, 3)):
        wire.received(time_us, sequence, Telemetry(report()))
    health = wire.history.health_at(1e9)
    assert health is not None
    assert health.lost_telemetry == 3


def test_damage_at_the_board_counts_from_the_first_report_on() -> None:
    wire = Wire()
    for time_us, errors in ((0, 65_534), (100_000, 65_535), (200_000, 2)):
        wire.received(time_us, time_us // 100_000, Telemetry(report(link_errors=errors)))
    health = wire.history.health_at(1e9)
    assert health is not None
    assert health.board_errors == 4


def test_a_change_of_state_is_never_left_out() -> None:
    wire = Wire()
    for tick, state in enumerate((State.ACTIVE, State.ACTIVE, State.STOPPED, State.STOPPED)):
        wire.received(tick * 20_000, tick, Telemetry(report(state)))
    board = wire.history.board_at(45_000)
    assert board is not None
    assert board.state is State.STOPPED
    assert board.time_us == 40_000
    assert board.pulses_us == (1500.0, 1000.0)
    assert math.isclose(board.setpoint_rad[0], math.pi / 2)


def test_waiting_for_the_boot_loader_is_no_trouble_of_the_link() -> None:
    wire = Wire()
    for time_us in (0, 100_000, 200_000):
        wire.sent(time_us, 1, GetState())
    hello = HelloReply.unpack(bytes(HelloReply.SIZE))
    wire.history.frame("received", 1, encode_frame(HelloReply.ID, 1, hello.pack()))
    wire.received(300_000, 1, Telemetry(report()))
    health = wire.history.health_at(1e9)
    assert health is not None
    assert health.retries == 0


def test_bytes_that_are_no_frame_are_ignored() -> None:
    wire = Wire()
    wire.history.frame("received", 0, b"\x02\x01\x00")
    wire.history.frame("sideways", 0, b"\x00")
    assert wire.history.board_at(1e9) is None
