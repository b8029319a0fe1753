"""Classes that users name or pass."""

import pytest

from ccr_host.commands.options import complete_controllers, complete_plants, complete_trackers
from ccr_host.control.registry import make_controller
from ccr_host.core.errors import CcrError, CodeError, ConfigError
from ccr_host.core.plugins import Given, make_plugin, plugin, plugin_names
from ccr_host.description.schema import Description
from ccr_host.run.tracker_rig import open_tracker
from ccr_host.sim.robot.scene import make_plant
from ccr_host.tracking.uri import TrackerKind, parse_tracker_uri

CLASSES = """
from __future__ import annotations
from dataclasses import dataclass
import neighbour

class Mine:
    def __init__(self, description): self.told = neighbour.WORD
    def start(self, reference): ...
    def step(self, observation): ...

@dataclass
class Unfinished:
    description: object
    def start(self, reference): ...

class Demanding:
    def __init__(self, description, gain): ...

class Broken:
    def __init__(self, description): raise ValueError("my\\ngain")

number = 3
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(CLASSES)
    (tmp_path / "neighbour.py").write_text("WORD = 'from next door'")
    return path


def refusal(file_text, path, wanted="Mine", kind="controller"):
    path.write_text(file_text)
    with pytest.raises(CcrError) as refused:
        make_plugin(kind, f"{path}:{wanted}", ("start", "step"), Description())
    assert refused.value.exit_status == 2
    assert "\n" not in str(refused.value)
    return refused.value


def test_a_class_in_a_file_is_made_and_may_import_its_neighbours(file):
    assert make_controller(f"{file}:Mine", Description()).told == "from next door"


def test_a_file_is_loaded_once_and_again_when_it_was_changed(file):
    first = plugin("controller", f"{file}:Mine")
    assert plugin("controller", f"{file}:Mine") is first
    file.write_text(CLASSES + "\n\n")
    assert plugin("controller", f"{file}:Mine") is not first


@pytest.mark.parametrize(
    ("text", "wanted", "told"),
    [
        (CLASSES, "Min", "no class Min in .*it has Mine, Unfinished, Demanding, Broken"),
        ("import os", "Mine", "no class Mine in .*it has none"),
        (CLASSES, "Unfinished", "'Unfinished' object has no attribute 'step'"),
        (CLASSES, "Demanding", "missing 1 required positional argument: 'gain'"),
        (CLASSES, "Broken", r"ValueError: my gain \(correct its class\)"),
        (CLASSES, "number", "'int' object is not callable"),
        ("class Mine(", "Mine", "SyntaxError"),
        ("import nothing_of_this_name", "Mine", "No module named 'nothing_of_this_name'"),
        ("1 / 0", "Mine", "ZeroDivisionError"),
        ("import sys; sys.exit(0)", "Mine", "SystemExit: 0"),
        ("\0", "Mine", "SyntaxError|ValueError"),
    ],
)
def test_an_error_in_a_file_or_class_is_reported_in_one_line(file, text, wanted, told):
    error = refusal(text, file, wanted)
    assert error.args
    with pytest.raises(CcrError, match=told):
        raise error
    assert isinstance(error, ConfigError) or "Traceback" in error.traceback


def test_an_unreadable_file_is_reported(tmp_path):
    for name, told in ((tmp_path / "gone.py", "No such file"), (tmp_path, "no class")):
        with pytest.raises(CcrError) as refused:
            make_controller(f"{name}:Mine", Description())
        assert isinstance(refused.value, ConfigError)
        assert told in str(refused.value) or "unknown controller" in str(refused.value)
    folder = tmp_path / "folder.py"
    folder.mkdir()
    with pytest.raises(ConfigError, match="a folder"):
        make_controller(f"{folder}:Mine", Description())


@pytest.mark.parametrize("name", ["mine.py", "mine.py:", "mine.py:My-Class", "mine:Class", ""])
def test_a_name_that_is_nearly_right_gets_the_form(name):
    for make in (make_controller, make_plant):
        with pytest.raises(ConfigError, match=r"unknown .* or FILE\.py:CLASS"):
            make(name, Description())
    with pytest.raises(ConfigError, match=r"FILE\.py:CLASS"):
        parse_tracker_uri(name)


class Handed:
    def __init__(self, description):
        self.description = description

    def start(self, reference):
        pass

    def step(self, observation):
        pass


def test_what_is_handed_over_in_python_is_a_class_a_function_or_an_object():
    description = Description()
    assert make_controller(Given(Handed), description).description is description
    assert make_controller(Given(lambda d: Handed([d])), description).description == [description]
    mine = Handed(3)
    assert make_controller(Given(mine), description) is mine
    assert Given(Handed) == Given(mine) == "python:Handed"


def test_one_that_was_handed_over_elsewhere_is_refused():
    with pytest.raises(ConfigError, match="was passed as an object in Python"):
        make_controller("python:Handed", Description())


@pytest.fixture
def installed(monkeypatch, tmp_path):
    """A package with plug-ins of every kind, and one that fails."""
    about = tmp_path / "lab-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[ccr_host.controllers]\nlab-law = lab:Law\nlab-broken = lab_broken:Law\n"
        "[ccr_host.trackers]\nlab-camera = lab:Camera\n[ccr_host.plants]\nlab-arm = lab:Arm\n"
    )
    (tmp_path / "lab.py").write_text(
        """
class Law:
    def __init__(self, description): pass
    def start(self, reference): pass
    def step(self, observation): pass

class Camera:
    def __init__(self, description, address=""): self.address = address
    def start(self): pass
    stop = start
    def advance_to(self, time_us): pass
    def newest_frame(self): pass

class Arm:
    def __init__(self, description): pass
    def set_pulses_half_us(self, pulses): pass
    def advance_to(self, time_us): pass
    def markers_mm(self): return [[0, 0, 0], [0, -58.5, 0], [0, -102, 0]]
"""
    )
    (tmp_path / "lab_broken.py").write_text("raise RuntimeError('no licence')")
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.usefixtures("installed")
def test_plugins_of_installed_packages_are_had_by_name_and_listed():
    assert type(make_controller("lab-law", Description())).__name__ == "Law"
    assert make_plant("lab-arm", Description()).tip_mm().tolist() == [0, -102, 0]
    for text, address in (("lab-camera:/dev/lab:0", "/dev/lab:0"), ("lab-camera:", "")):
        uri = parse_tracker_uri(text)
        assert uri.kind is TrackerKind.OWN
        assert str(uri) == text
        assert open_tracker(uri, Description()).address == address
    with pytest.raises(ConfigError, match=r"mpc, .*lab-broken, lab-law or FILE"):
        make_controller("lab", Description())
    with pytest.raises(ConfigError, match=r"one of twin, lab-arm or FILE"):
        make_plant("lab", Description())
    with pytest.raises(ConfigError, match=r"lab-camera:\[ADDRESS\], FILE"):
        parse_tracker_uri("lab:")
    with pytest.raises(CodeError, match="no licence"):
        make_controller("lab-broken", Description())


@pytest.mark.usefixtures("installed")
def test_plugins_of_installed_packages_are_completed():
    assert complete_controllers("lab") == ["lab-broken", "lab-law"]
    assert complete_trackers("l") == ["lab-camera:"]
    assert complete_trackers("FILE") == []
    assert complete_plants("") == ["twin", "lab-arm"]


def test_the_replayed_tracker_is_found_as_such_a_plugin():
    assert "replay" in plugin_names("tracker")
