"""The emulated camera's control unit, command by command."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.description.simulation import Tracker
from ccr_host.sim.polaris.device import Mode, PolarisDevice
from ccr_host.sim.polaris.sensor import Placement, PolarisFaults, PositionSensor
from ccr_host.tracking.sources.ndi.replies import encode_command, parse_tx
from ccr_host.tracking.sources.ndi.rom import (
    DUMMY_MARKERS_MM,
    dummy_passive_rom,
    make_passive_rom,
    rom_blocks,
)
from tests.exposer import Exposer

MARKERS_MM = np.array([(0.0, 0.0, 15.0), (1.0, -58.0, 12.0), (20.0, -90.0, 10.0)])


class Host:
    """Sends commands; time advances only on request."""

    def __init__(
        self,
        faults: PolarisFaults | None = None,
        latency_us: int = 0,
        markers_mm: np.ndarray = MARKERS_MM,
    ) -> None:
        sensor = PositionSensor(
            np.random.default_rng(1),
            Tracker(noise_mm=0.0, latency_ms=latency_us / 1000),
            faults=faults or PolarisFaults(),
        )
        self.device = PolarisDevice(sensor)
        self.exposer = Exposer(sensor, lambda _: markers_mm)
        self.time_us = 0

    def __call__(self, name: str, arguments: str = "") -> str:
        line = encode_command(name, arguments).removesuffix(b"\r")
        return self.device.execute(line, self.time_us).text

    def wait_ms(self, duration_ms: int) -> None:
        self.time_us += duration_ms * 1000
        self.exposer.advance_to(self.time_us)

    def load(self, rom: bytes) -> str:
        handle = self("PHRQ", "*********1****")
        for address, block in rom_blocks(rom):
            assert self("PVWR", f"{handle}{address:04X}{block.hex().upper()}") == "OKAY"
        return handle

    def track(self, *, enable: bool = True) -> None:
        assert self("INIT") == "OKAY"
        handle = self.load(dummy_passive_rom())
        if enable:
            assert self("PINIT", handle) == "OKAY"
            assert self("PENA", handle + "D") == "OKAY"
        assert self("TSTART", "80") == "OKAY"


def test_start_up_and_tracking():
    host = Host()
    host.wait_ms(30)
    host.track()
    host.wait_ms(100)
    reply = parse_tx(host("TX", "1801"))
    assert [tool.pose for tool in reply.tools] == [None]
    assert reply.frame == 6
    assert len(reply.strays_mm) == 3
    assert host("TSTOP") == "OKAY"
    assert host("TX", "1801") == "ERROR0C"


@pytest.mark.parametrize("segments", [1, 2, 4])
def test_tools_by_name_are_at_the_markers_of_a_robot_of_any_size(segments):
    markers_mm = np.arange(3.0 * segments + 3.0).reshape(-1, 3) - (0.0, 0.0, 5.0)
    host = Host(markers_mm=markers_mm)
    assert host("INIT") == "OKAY"
    for number in range(1, segments + 3):
        handle = host.load(make_passive_rom(np.array(DUMMY_MARKERS_MM), f"CCR-M{number}"))
        assert host("PINIT", handle) == "OKAY"
        assert host("PENA", handle + "D") == "OKAY"
    assert host("TSTART", "80") == "OKAY"
    host.wait_ms(200)
    reply = parse_tx(host("TX", "1801"))
    assert [tool.pose is None for tool in reply.tools] == [False] * (segments + 1) + [True]
    assert len(reply.strays_mm) == 0
    places_mm = [tool.pose.position_mm for tool in reply.tools[:-1]]
    np.testing.assert_allclose(places_mm, Placement().to_camera(markers_mm), atol=0.01)


def test_illuminators_stay_dark_without_an_enabled_passive_tool():
    host = Host()
    host.track(enable=False)
    host.wait_ms(100)
    assert len(parse_tx(host("TX", "1801")).strays_mm) == 0


def test_counter_runs_at_60_hz_and_data_come_at_20():
    host = Host()
    host.track()
    frames = []
    for _ in range(200):
        host.wait_ms(5)
        frames.append(parse_tx(host("TX", "1801")).frame)
    assert sorted(set(frames)) == list(range(frames[0], frames[-1] + 1, 3))
    assert frames[-1] - frames[0] == pytest.approx(60, abs=3)


def test_image_arrives_after_the_latency():
    host = Host(latency_us=40_000)
    host.track()
    host.wait_ms(50)
    before = parse_tx(host("TX", "1801")).frame
    host.wait_ms(39)
    assert parse_tx(host("TX", "1801")).frame == before
    host.wait_ms(1)
    assert parse_tx(host("TX", "1801")).frame == before + 3


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"INIT:E3A6", "04"),
        (b"INIT:", "04"),
        (b"init ", "01"),
        (b"NOSUCH ", "01"),
        (b"\xff\xfe", "01"),
        (b"PHSR 00", "10"),
        (b"TX 1801", "10"),
        (b"TSTART 80", "10"),
        (b"COMM 90000", "23"),
    ],
)
def test_refusals_before_init(line, code):
    assert Host().device.execute(line, 0).text == f"ERROR{code}"


@pytest.mark.parametrize(
    ("name", "arguments", "code"),
    [
        ("PHF", "0A", "08"),
        ("PINIT", "0A", "08"),
        ("PENA", "0AD", "08"),
        ("PINIT", "01", "0D"),
        ("PENA", "01D", "0E"),
        ("PDIS", "01", "0F"),
        ("TX", "1801", "0C"),
        ("TSTOP", "", "0C"),
        ("PHRQ", "nonsense", "07"),
        ("PVWR", "010000AB", "07"),
        ("PVWR", "010001" + "00" * 64, "23"),
        ("PHSR", "xx", "07"),
        ("PHSR", "09", "23"),
    ],
)
def test_refusals_in_setup_mode(name, arguments, code):
    host = Host()
    host("INIT")
    host("PHRQ", "*********1****")
    assert host(name, arguments) == f"ERROR{code}"


@pytest.mark.parametrize("name", ["INIT", "PHSR", "PHRQ", "TSTART"])
def test_set_up_commands_are_refused_while_tracking(name):
    host = Host()
    host.track()
    assert host(name) == "ERROR0C"


def test_damaged_tool_definition_fails_at_pinit():
    host = Host()
    host("INIT")
    handle = host.load(dummy_passive_rom())
    host("PVWR", f"{handle}0040" + "FF" * 64)
    assert host("PINIT", handle) == "ERROR13"


def test_handles_run_out_and_are_freed():
    host = Host()
    host("INIT")
    handles = []
    while not (answer := host("PHRQ", "*********1****")).startswith("ERROR"):
        handles.append(answer)
    assert answer == "ERROR2D"
    assert host("PHSR", "00") == f"{len(handles):02X}" + "".join(f"{h}000" for h in handles)
    for handle in handles:
        assert host("PHF", handle) == "OKAY"
    assert host("PHSR", "00") == "00"


def test_phsr_selects_by_state():
    host = Host()
    host("INIT")
    first = host.load(dummy_passive_rom())
    assert host("PHSR", "02") == f"01{first}001"
    host("PINIT", first)
    assert host("PHSR", "02") == "00"
    assert host("PHSR", "03") == f"01{first}011"
    host("PENA", first + "D")
    assert host("PHSR", "03") == "00"
    assert host("PHSR", "04") == f"01{first}031"


def test_comm_announces_the_new_rate_and_reset_the_old_one():
    device = Host().device
    answer = device.execute(b"COMM 50000", 0)
    assert (answer.text, answer.new_baud) == ("OKAY", 115_200)
    assert device.execute(b"RESET ", 0) is None


def test_markers_out_of_volume_are_left_out_unless_asked_for():
    host = Host(PolarisFaults(out_of_volume=True))
    host.track()
    host.wait_ms(100)
    assert len(parse_tx(host("TX", "1801")).strays_mm) == 3
    assert len(parse_tx(host("TX", "1001")).strays_mm) == 0


def test_occlusion_of_all_markers_for_a_while():
    host = Host(PolarisFaults(occluded_us=((100_000, 200_000),)))
    host.track()
    counts = []
    for _ in range(5):
        host.wait_ms(50)
        counts.append(len(parse_tx(host("TX", "1801")).strays_mm))
    assert counts == [3, 0, 0, 3, 3]


@given(st.binary(max_size=60))
def test_any_line_is_answered_and_none_breaks_the_device(line):
    host = Host()
    host("INIT")
    text = host.device.execute(line, 0).text
    assert text
    assert host.device.mode in (Mode.SETUP, Mode.TRACKING)
