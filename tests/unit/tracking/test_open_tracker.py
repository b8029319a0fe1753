"""Tracker URIs."""

import numpy as np
import pytest

from ccr_host.core import plugins as optional
from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description
from ccr_host.description.simulation import Tracker
from ccr_host.run.tracker_rig import TrackerRig, open_tracker
from ccr_host.tracking.sources.ndi.driver import NdiTracker
from ccr_host.tracking.sources.ndi.rom import dummy_passive_rom
from ccr_host.tracking.uri import TrackerKind, TrackerUri, parse_tracker_uri


@pytest.mark.parametrize(
    ("text", "kind", "address"),
    [
        ("twin:", TrackerKind.TWIN, ""),
        ("ndi-emulator:", TrackerKind.NDI_EMULATOR, ""),
        ("ndi:/dev/ttyUSB0", TrackerKind.NDI_SERIAL, "/dev/ttyUSB0"),
        ("ndi:COM3", TrackerKind.NDI_SERIAL, "COM3"),
        ("ndi:/dev/cu.usbserial-1420", TrackerKind.NDI_SERIAL, "/dev/cu.usbserial-1420"),
        ("ndi+tcp://camera.lab:8765", TrackerKind.NDI_TCP, "camera.lab:8765"),
        ("igtl://localhost:18944", TrackerKind.IGTL, "localhost:18944"),
        ("aruco:0", TrackerKind.ARUCO, "0"),
        ("replay:runs/a:b/log_0000.mcap", TrackerKind.REPLAY, "runs/a:b/log_0000.mcap"),
    ],
)
def test_known_forms_are_read_and_written_back(text, kind, address):
    uri = parse_tracker_uri(text)
    assert uri == TrackerUri(kind, address)
    assert str(uri) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "twin",
        "twin:1",
        "ndi-emulator:x",
        "ndi:",
        "ndi+tcp:host:1",
        "ndi+tcp://host",
        "ndi+tcp://host:0",
        "ndi+tcp://host:65536",
        "igtl://:1",
        "aruco:",
        "aruco:x",
        "replay:",
        "vicon://host",
    ],
)
def test_other_forms_are_refused_with_an_example(text):
    with pytest.raises(ConfigError) as refusal:
        parse_tracker_uri(text)
    assert refusal.value.cure


CAMERA = """
class Cam:
    def __init__(self, description, *address): self.address = address
    def start(self): ...
    def advance_to(self, time_us): ...
    def newest_frame(self): ...
    stop = start

class Simulated(Cam):
    next_exposure_us = 0
    def expose(self, time_us, markers_mm): ...

class Late(Cam):
    def __init__(self, description):
        super().__init__(description)
        self.in_process = True

def function(description): return Cam(description)
def simulated(description): return Simulated(description)
"""


@pytest.mark.parametrize("address", ["", "/dev/x", "host:80", "a.py:B"])
def test_a_class_in_a_file_is_given_the_address_that_follows_it(tmp_path, address):
    (tmp_path / "cam.py").write_text(CAMERA)
    text = f"{tmp_path / 'cam.py'}:Cam" + (f":{address}" if address else "")
    uri = parse_tracker_uri(text)
    assert uri.kind is TrackerKind.OWN
    assert str(uri) == text
    assert open_tracker(uri, Description()).address == ((address,) if address else ())


def test_a_function_may_make_the_tracker_of_a_real_robot(tmp_path):
    (tmp_path / "cam.py").write_text(CAMERA)
    uri = parse_tracker_uri(f"{tmp_path / 'cam.py'}:function")
    assert type(open_tracker(uri, Description())).__name__ == "Cam"


@pytest.mark.parametrize("maker", ["simulated", "Late"])
def test_a_tracker_that_is_known_as_simulated_only_once_made_is_refused_with_a_cure(
    tmp_path, maker
):
    (tmp_path / "cam.py").write_text(CAMERA)
    uri = parse_tracker_uri(f"{tmp_path / 'cam.py'}:{maker}")
    with pytest.raises(ConfigError, match="only the finished") as refusal:
        open_tracker(uri, Description())
    assert "pass a class" in refusal.value.cure


def test_ndi_is_opened_only_when_started():
    uri = parse_tracker_uri("ndi:/dev/nosuchport")
    assert isinstance(open_tracker(uri, Description()), NdiTracker)


def test_aruco_without_calibration_says_what_to_set():
    with pytest.raises(ConfigError, match="calibration") as refusal:
        open_tracker(parse_tracker_uri("aruco:0"), Description())
    assert "camera_file" in refusal.value.cure


def test_one_tool_definition_for_two_markers_is_refused_by_their_names(tmp_path):
    (tmp_path / "a.rom").write_bytes(dummy_passive_rom())
    (tmp_path / "b.rom").write_bytes(dummy_passive_rom())
    files = {"M1": str(tmp_path / "a.rom"), "M2": str(tmp_path / "b.rom")}
    description = Description(tracker=Tracker(tool_files=files))
    with pytest.raises(ConfigError, match="M1 and M2 have the same tool definition"):
        TrackerRig(parse_tracker_uri("ndi-emulator:"), description, np.random.SeedSequence(1))


def test_twin_needs_the_twin():
    with pytest.raises(ConfigError, match="needs the twin"):
        open_tracker(parse_tracker_uri("twin:"), Description())


@pytest.mark.parametrize(
    ("text", "line"),
    [("igtl://localhost:1", "ccr-host[igtl]"), ("aruco:0", "ccr-host[aruco]")],
)
def test_missing_package_gives_the_line_that_installs_it(text, line, monkeypatch, tmp_path):
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(optional.importlib, "import_module", missing)
    camera_file = tmp_path / "camera.yaml"
    camera_file.write_text(
        "camera_matrix:\n  data: [600, 0, 320, 0, 600, 240, 0, 0, 1]\n"
        "distortion_coefficients:\n  data: [0, 0, 0, 0, 0]\n"
    )
    tracker = Tracker(camera_file=str(camera_file), tag_size_mm=20)
    with pytest.raises(ConfigError, match="not installed") as refusal:
        open_tracker(parse_tracker_uri(text), Description(tracker=tracker))
    assert line in refusal.value.cure
