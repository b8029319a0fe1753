"""The driver against the emulated camera, in virtual time, with everything that can go wrong."""

import numpy as np
import pytest

from ccr_host.core.clock import VirtualClock
from ccr_host.core.errors import ConfigError, TrackerError
from ccr_host.sim.polaris.device import Mode, PortHandle
from ccr_host.sim.polaris.sensor import BitOrder, Placement, PolarisFaults
from ccr_host.tracking.sources.ndi.driver import NdiSettings, NdiTracker
from ccr_host.tracking.sources.ndi.port import tcp_opener
from ccr_host.tracking.sources.ndi.replies import encode_command
from ccr_host.tracking.sources.ndi.rom import (
    DUMMY_MARKERS_MM,
    dummy_passive_rom,
    load_rom,
    make_passive_rom,
    rom_blocks,
)
from ccr_host.tracking.sources.ndi.session import Tool
from ccr_host.tracking.tracker import wait_until_tracking
from tests.exposer import running
from tests.unit.tracking.sources.ndi.conftest import MARKERS_MM

CAMERA_MM = Placement().to_camera(MARKERS_MM)
FIVE_S_US = 5_000_000


def test_markers_are_seen_within_the_resolution_of_the_protocol(bench):
    run = bench()
    run.run_until_tracking()
    (*_, frame) = run.run_ms(1000)
    np.testing.assert_allclose(frame.points_mm, CAMERA_MM, atol=0.005 + 1e-9)
    assert not frame.out_of_volume.any()
    assert frame.tools == {}


def test_every_frame_comes_once_and_in_order(bench):
    run = bench()
    run.run_until_tracking()
    frames = run.run_ms(10_000)
    numbers = [frame.frame_number for frame in frames]
    assert set(np.diff(numbers)) == {3}
    assert len(frames) == pytest.approx(200, abs=1)
    health = run.tracker.health
    assert health.lost_frames == 0
    assert health.rate_hz == pytest.approx(20, rel=0.01)
    assert health.warnings == ()


@pytest.mark.parametrize("paced", [True, False])
def test_time_of_exposure_is_known_within_2_ms(bench, paced):
    run = bench(paced=paced)
    run.run_until_tracking()
    run.run_ms(2000)
    errors_us = [frame.exposed_us % 50_000 for frame in run.run_ms(10_000)]
    assert min(errors_us) >= 0
    assert max(errors_us) <= 2000


def test_marker_positions_are_those_at_the_time_of_exposure(bench):
    speed_mm_s = np.array([0.0, 0.0, 20.0])
    run = bench(motion=lambda time_us: MARKERS_MM + speed_mm_s * time_us * 1e-6)
    run.run_until_tracking()
    run.run_ms(2000)
    for frame in run.run_ms(2000):
        moved_mm = frame.points_mm - CAMERA_MM
        np.testing.assert_allclose(moved_mm[:, 2], 20 * frame.exposed_us * 1e-6, atol=0.1)


def test_sample_is_as_old_as_latency_one_poll_and_the_wire_make_it(bench):
    run = bench(latency_ms=40.0)
    run.run_until_tracking()
    run.run_ms(2000)
    ages_us = []
    last = run.tracker.newest_frame()
    for _ in range(5000):
        run.clock.sleep_until_us(run.clock.now_us() + 1000)
        newest = run.tracker.newest_frame()
        if newest is not last:
            ages_us.append(run.clock.now_us() - newest.exposed_us)
            last = newest
    assert 40_000 < np.median(ages_us) < 56_000


def test_same_seed_gives_the_same_frames(bench):
    runs = [bench(noise_mm=0.25, seed=7) for _ in range(2)]
    first, second = (
        [(f.exposed_us, f.points_mm.tobytes()) for f in run.run_ms(4000)] for run in runs
    )
    assert first
    assert first == second


def test_out_of_volume_is_our_own_check_in_both_bit_orders(bench):
    beyond = np.array([(0.0, 0.0, 0.0), (0.0, 0.0, -500.0), (600.0, 0.0, 0.0)])
    for order in BitOrder:
        run = bench(PolarisFaults(bit_order=order), motion=lambda _: beyond)
        run.run_until_tracking()
        (*_, frame) = run.run_ms(200)
        assert frame.out_of_volume.tolist() == [False, True, True]


def test_scene_out_of_volume_is_still_delivered_and_marked(bench):
    run = bench(PolarisFaults(out_of_volume=True))
    run.run_until_tracking()
    (*_, frame) = run.run_ms(200)
    assert len(frame.points_mm) == 3
    assert frame.out_of_volume.all()


def test_three_tools_are_tracked_by_name_and_are_no_strays(bench):
    tools = [
        Tool(name, make_passive_rom(np.array(DUMMY_MARKERS_MM), f"CCR-{name}"))
        for name in ("M1", "M2", "M3")
    ]
    run = bench(settings=NdiSettings(tools=tools), rotation_deg=(3.0, -20.0, 45.0))
    run.run_until_tracking()
    (*_, frame) = run.run_ms(200)
    placement = Placement(rotation_deg=(3.0, -20.0, 45.0))
    assert set(frame.tools) == {"M1", "M2", "M3"}
    for name, marker_mm in zip(("M1", "M2", "M3"), placement.to_camera(MARKERS_MM), strict=True):
        np.testing.assert_allclose(frame.tools[name].position_mm, marker_mm, atol=0.006)
        np.testing.assert_allclose(frame.tools[name].quaternion, placement.quaternion(), atol=6e-5)
    assert len(frame.points_mm) == 0


def test_warning_05_of_pinit_is_accepted(bench):
    run = bench(PolarisFaults(pinit_warning=True))
    run.run_until_tracking()
    assert run.tracker.health.last_error == ""


def test_temperature_and_diagnostics_are_readable_warnings(bench):
    run = bench(PolarisFaults(too_hot=True, diagnostic_pending=True))
    run.run_until_tracking()
    text = " ".join(run.tracker.health.warnings)
    assert "temperature" in text
    assert "diagnostics" in text


def test_repeated_frames_are_dropped_and_counted_as_lost(bench):
    run = bench(PolarisFaults(frozen=0.3))
    run.run_until_tracking()
    frames = run.run_ms(10_000)
    assert np.all(np.diff([frame.frame_number for frame in frames]) > 0)
    assert len(frames) / 200 == pytest.approx(0.7, abs=0.1)
    health = run.tracker.health
    assert health.frames + health.lost_frames == pytest.approx(203, abs=6)


def test_damaged_replies_cost_frames_but_never_give_a_wrong_marker(bench):
    run = bench(PolarisFaults(bad_crc=0.2))
    run.run_until_tracking()
    frames = run.run_ms(20_000)
    assert len(frames) > 250
    for frame in frames:
        np.testing.assert_allclose(frame.points_mm, CAMERA_MM, atol=0.006)
    assert run.tracker.health.damaged_replies > 50


def test_shuffled_strays_and_phantoms_are_delivered_as_they_come(bench):
    run = bench(PolarisFaults(shuffle=True, phantoms=2))
    run.run_until_tracking()
    frames = run.run_ms(2000)
    orders = set()
    for frame in frames:
        assert len(frame.points_mm) == 5
        distance_mm = np.linalg.norm(frame.points_mm[:, None] - CAMERA_MM, axis=2)
        assert (distance_mm.min(axis=0) < 0.01).all()
        orders.add(tuple(distance_mm.argmin(axis=0)))
    assert len(orders) > 5


def test_occlusion_leaves_frames_with_fewer_points(bench):
    run = bench(PolarisFaults(occlusion=0.2))
    run.run_until_tracking()
    counts = [len(frame.points_mm) for frame in run.run_ms(20_000)]
    assert np.mean(counts) == pytest.approx(2.4, abs=0.15)


def test_silence_is_noticed_and_tracking_resumes(bench):
    run = bench(PolarisFaults(silent_us=((5_000_000, 9_000_000),)))
    run.run_until_tracking()
    before = run.run_ms(6_500 - run.clock.now_us() // 1000)
    assert before
    assert not run.tracker.health.tracking
    assert "does not answer" in run.tracker.health.last_error
    run.run_ms(13_000)
    health = run.tracker.health
    assert health.tracking
    assert health.reconnections >= 1
    after = run.run_ms(1000)
    assert len(after) == pytest.approx(20, abs=1)
    assert after[0].exposed_us > before[-1].exposed_us


def test_device_reset_in_mid_run_is_started_again(bench):
    run = bench()
    run.run_until_tracking()
    last = run.run_ms(500)[-1]
    run.line.set_break(True)
    run.line.set_break(False)
    run.run_ms(15_000)
    frames = run.run_ms(1000)
    assert len(frames) == pytest.approx(20, abs=1)
    assert frames[0].exposed_us > last.exposed_us
    assert run.tracker.health.reconnections >= 1


@pytest.mark.long
@pytest.mark.parametrize("baud", [9600, 19_200, 57_600, 115_200, 230_400, 921_600, 1_228_739])
@pytest.mark.parametrize("has_break", [True, False])
def test_device_left_tracking_at_another_rate_is_recovered(bench, baud, has_break):
    run = bench()
    run.line.device_baud = baud
    run.line.has_break = has_break
    run.line.device.mode = Mode.TRACKING
    run.run_until_tracking()
    assert len(run.run_ms(1000)) == pytest.approx(20, abs=1)


def test_rates_that_the_adapter_does_not_have_are_left_out(bench):
    run = bench()
    run.line.has_break = False
    run.line.device_baud = 57_600
    set_baud = run.line.set_baud

    def set_a_usual_baud(baud: int) -> None:
        if baud > 115_200:
            raise TrackerError(f"the port does not take {baud} baud", "use another adapter")
        set_baud(baud)

    run.line.set_baud = set_a_usual_baud
    run.run_until_tracking()


def test_camera_that_refuses_a_faster_rate_is_tracked_at_the_slow_one(bench):
    run = bench(PolarisFaults(comm_refused=True, phantoms=15))
    run.run_until_tracking()
    frames = run.run_ms(10_000)
    assert run.line.device_baud == 9600
    assert len(frames) > 15
    assert run.tracker.health.last_error == ""
    assert any("9600 baud" in text and "ERROR06" in text for text in run.tracker.health.warnings)
    errors_us = [frame.exposed_us % 50_000 for frame in frames[5:]]
    assert max(errors_us) <= 5000


@pytest.mark.long
@pytest.mark.parametrize("start_s", [0.0, 6.0])
@pytest.mark.parametrize("duration_s", [0.06, 3.0])
def test_frame_numbers_that_jump_cost_a_second_and_are_counted(bench, start_s, duration_s):
    odd_us = (round(start_s * 1e6), round((start_s + duration_s) * 1e6))
    run = bench()
    run.run_until_tracking()
    shift_us = run.clock.now_us()
    run.line.device.sensor.faults = PolarisFaults(
        wrong_frames_us=((odd_us[0] + shift_us, odd_us[1] + shift_us),)
    )
    frames = run.run_ms(12_000)
    assert len(frames) > 12 * 20 - 2 * 22
    health = run.tracker.health
    assert 1 <= health.odd_frame_numbers <= 2
    assert any("frame counter" in text for text in health.warnings)
    assert health.lost_frames < 60
    assert np.all(np.diff([frame.exposed_us for frame in frames]) > 0)
    errors_us = [frame.exposed_us % 50_000 for frame in run.run_ms(2000)]
    assert max(errors_us) <= 2000


def test_first_frame_number_that_is_far_too_high_does_not_blind(bench):
    run = bench(PolarisFaults(wrong_frames_us=((0, 3_000_000),)))
    run.run_until_tracking()
    run.run_ms(3000)
    assert len(run.run_ms(1000)) == pytest.approx(20, abs=1)
    assert run.tracker.health.odd_frame_numbers >= 1


def test_camera_that_repeats_one_frame_gives_no_new_ones(bench):
    run = bench()
    run.run_until_tracking()
    run.line.device.sensor.faults = PolarisFaults(frozen=1.0)
    assert len(run.run_ms(5000)) <= 1
    assert run.tracker.health.odd_frame_numbers == 0


def test_stale_handles_of_an_earlier_program_are_freed(bench):
    run = bench()
    run.line.has_break = False
    device = run.line.device
    device.handles = {number: PortHandle(number) for number in range(1, 16)}
    run.run_until_tracking()
    assert len(device.handles) == 1


def test_line_lost_is_opened_again(bench):
    run = bench()
    run.run_until_tracking()
    run.run_ms(200)
    gone_until_us = run.clock.now_us() + 3_000_000

    def read() -> bytes:
        if run.clock.now_us() < gone_until_us:
            raise TrackerError("the port is gone", "plug it in")
        return type(run.line).read(run.line)

    run.line.read = read
    run.run_ms(2000)
    assert "the port is gone" in run.tracker.health.last_error
    run.run_ms(10_000)
    assert run.tracker.health.tracking


def test_stop_leaves_the_camera_dark_and_is_harmless_twice(bench):
    run = bench()
    run.run_until_tracking()
    run.tracker.stop()
    run.tracker.stop()
    run.run_ms(50)
    assert run.line.device.mode is Mode.SETUP
    assert not run.line.device.sensor.illuminated
    assert run.tracker.health.state == "stopped"


def test_no_camera_is_one_clear_line_with_what_was_tried():
    clock = VirtualClock()

    class DeadLine:
        name = "dead"
        has_baud = has_break = True
        write = set_baud = set_break = lambda self, _: None
        read = staticmethod(bytes)
        close = staticmethod(lambda: None)

    tracker = NdiTracker("ndi:/dev/ttyUSB0", DeadLine)
    clock.attach(tracker)
    with (
        running(tracker),
        pytest.raises(TrackerError, match="ndi:/dev/ttyUSB0: no frame") as refusal,
    ):
        wait_until_tracking(tracker, clock)
    assert "does not answer" in refusal.value.cure


class Speaker:
    """A line on which something else than a camera talks."""

    name = "speaker"
    has_break = False

    def __init__(self, says: bytes, *, has_baud: bool) -> None:
        self._says = says
        self._queue = says
        self.has_baud = has_baud

    def write(self, data: bytes) -> None:
        self._queue += self._says or data

    def read(self) -> bytes:
        data, self._queue = self._queue, b""
        return data

    set_baud = set_break = lambda self, _: None
    close = staticmethod(lambda: None)


@pytest.mark.parametrize(
    ("says", "shown"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "HTTP/1.1"),
        (b"SSH-2.0-OpenSSH_9.2p1\r\n", "SSH-2.0"),
        (b"$GPGGA,123519,4807.038,N", "GPGGA"),
        (bytes(range(256)) * 40, "x00"),
        (b"", "INIT:E3A5"),  # it echoes
    ],
)
@pytest.mark.parametrize("has_baud", [True, False])
def test_what_is_no_camera_is_called_so_with_what_it_said(says, shown, has_baud):
    clock = VirtualClock()
    tracker = NdiTracker("ndi:there", lambda: Speaker(says, has_baud=has_baud))
    clock.attach(tracker)
    with running(tracker), pytest.raises(TrackerError, match="no NDI camera") as refusal:
        wait_until_tracking(tracker, clock)
    assert shown in str(refusal.value)
    if not has_baud:  # on a serial line a camera may still be starting
        assert clock.now_us() < FIVE_S_US


def test_what_closes_the_connection_again_and_again_is_given_up_within_seconds():
    class Closing(Speaker):
        def read(self) -> bytes:
            raise TrackerError("the other end has closed the connection", "see why")

    clock = VirtualClock()
    tracker = NdiTracker("ndi+tcp://there", lambda: Closing(b"", has_baud=False))
    clock.attach(tracker)
    with running(tracker), pytest.raises(TrackerError, match=r"no frame within [345] s") as refusal:
        wait_until_tracking(tracker, clock)
    assert "closed the connection" in refusal.value.cure


def test_only_the_first_connection_may_take_seconds(monkeypatch):
    timeouts_s = []

    def unreachable(_address, timeout_s: float):
        timeouts_s.append(timeout_s)
        raise TimeoutError

    monkeypatch.setattr("socket.create_connection", unreachable)
    open_port = tcp_opener("192.0.2.1:8765")
    for _ in range(3):
        with pytest.raises(TrackerError):
            open_port()
    assert timeouts_s[0] >= 3
    assert max(timeouts_s[1:]) <= 0.1


def test_wait_until_tracking_returns_at_the_first_frame(bench):
    run = bench()
    wait_until_tracking(run.tracker, run.clock)
    assert run.clock.now_us() < FIVE_S_US


def test_dummy_tool_matches_nothing_that_the_robot_could_form():
    markers = np.array(DUMMY_MARKERS_MM)
    distances = np.linalg.norm(markers[:, None] - markers, axis=2)[np.triu_indices(4, 1)]
    assert distances.min() > 125
    assert np.diff(np.sort(distances)).min() > 3  # unique geometry


def test_rom_upload_is_whole_blocks_that_give_the_file_back(tmp_path):
    rom = dummy_passive_rom()
    blocks = list(rom_blocks(rom))
    assert [address for address, _ in blocks] == list(range(0, 768, 64))
    assert b"".join(block for _, block in blocks) == rom.ljust(768, b"\0")
    assert b"CCR-ILLUMINATE\0" in rom
    path = tmp_path / "tool.rom"
    path.write_bytes(rom)
    assert load_rom(path) == rom
    path.write_bytes(rom[:100] + b"\x01" + rom[101:])
    with pytest.raises(ConfigError, match="wrong check sum"):
        load_rom(path)
    path.write_bytes(rom[:-1])
    with pytest.raises(ConfigError, match="cut short, 751 of 752"):
        load_rom(path)
    path.write_bytes(b"hello")
    with pytest.raises(ConfigError, match=r"not a \.rom"):
        load_rom(path)
    with pytest.raises(ConfigError, match="No such file"):
        load_rom(tmp_path / "missing.rom")


def test_farewell_is_a_whole_command():
    assert encode_command("TSTOP").endswith(b"\r")
