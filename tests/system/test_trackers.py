"""Trackers from the user's point of view: runs with the emulated Polaris, registration, monitor."""

import json
import re
import signal
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ccr_host.tracking.sources.ndi.rom import DUMMY_MARKERS_MM, make_passive_rom
from tests.foreign_servers import foreign_server
from tests.patience import PATIENCE_S
from tests.system.conftest import IN_REAL_TIME, PAPERS, CcrHost, Ended

Aligned = Callable[[str, str, str], dict]
"""Path, tracker and controller -> summary."""
SPREAD = 0.05
"""Standard deviation, over seeds 1 to 5, of the ratio of the errors under the two trackers, each of
which has its own noise, with either controller."""


def tracked(ccr_host: CcrHost, path: str, tracker: str, *words: str) -> dict:
    ended = ccr_host("track", path, *PAPERS, "--tracker", tracker, "--no-open", "--json", *words)
    assert ended.status == 0, ended.err
    return ended.summary


@pytest.fixture(scope="module")
def aligned(tmp_path_factory: pytest.TempPathFactory) -> Aligned:
    """Summaries of runs on the robot as described, each made once."""

    @cache
    def summary(path: str, tracker: str, controller: str) -> dict:
        ccr_host = CcrHost(tmp_path_factory.mktemp("aligned"))
        return tracked(ccr_host, path, tracker, "--controller", controller)

    return summary


@pytest.mark.parametrize("controller", ["mpc", pytest.param("adaptive", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "path",
    [
        "8shape",
        pytest.param("ellipse", marks=pytest.mark.slow),
        pytest.param("star", marks=pytest.mark.slow),
    ],
)
def test_the_emulated_polaris_is_as_good_as_the_simulated_camera(
    aligned: Aligned, path: str, controller: str
) -> None:
    direct, polaris = (aligned(path, tracker, controller) for tracker in ("twin:", "ndi-emulator:"))
    for error in ("mean_error_mm", "true_mean_error_mm"):
        assert polaris[error] == pytest.approx(direct[error], rel=4 * SPREAD)
    assert polaris["faults"] == []


QUICK_FIT = ("--set", "control.solver=compiled")


@pytest.mark.parametrize(
    ("tracker", "rotation_deg"),
    [
        ("ndi-emulator:", "[0, 127.28, 127.28]"),
        pytest.param("ndi-emulator:", "[50, -60, 45]", marks=pytest.mark.slow),
        pytest.param("ndi-emulator:", "17", marks=pytest.mark.slow),
        pytest.param("twin:", "[0, 127.28, 127.28]", marks=pytest.mark.slow),
        pytest.param("twin:", "17", marks=pytest.mark.slow),
    ],
)
def test_registered_in_the_users_own_file_a_turned_camera_is_as_good_as_an_aligned_one(
    ccr_host: CcrHost, aligned: Aligned, tracker: str, rotation_deg: str
) -> None:
    own = Path(ccr_host.folder / "mine.toml")
    own.write_text('name = "mine"  # keep this\n')
    turned = ("--robot", "mine.toml", "--set", f"tracker.rotation_deg={rotation_deg}")
    registered = ccr_host("register", "--tracker", tracker, "--json", *turned, *QUICK_FIT)
    assert registered.status == 0, registered.err
    assert json.loads(registered.out)["kept_in"] == "mine.toml"
    assert own.read_text().startswith('name = "mine"  # keep this\n')
    assert "[registration]" in own.read_text()
    corrected = tracked(ccr_host, "8shape", tracker, *turned)
    as_described = aligned("8shape", tracker, "mpc")
    for error in ("mean_error_mm", "true_mean_error_mm"):
        assert corrected[error] < 1.05 * as_described[error]


def test_register_refuses_a_robot_that_does_not_move_and_writes_nothing(ccr_host: CcrHost) -> None:
    stuck = ("--robot", "single", "--set", "twin.servo_rate_deg_s=0.01")
    ended = ccr_host("register", "--out", "robot.toml", *stuck)
    assert ended.status == 3
    told = r"motor 1 moved M2 by 0\.\d mm only; check its supply"
    assert re.search(told, ended.err.strip().splitlines()[-1])
    assert not (ccr_host.folder / "robot.toml").exists()


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("occluded_s=[[2, 12]]", "lacks M1, M2, M3"),
        ("unplugged_s=[[2, 12]]", "the port is gone"),
        ("reset_s=[2]", "reset in mid-conversation"),
    ],
)
def test_a_camera_that_fails_ends_the_run_and_says_why(
    ccr_host: CcrHost, long_path: str, fault: str, told: str
) -> None:
    words = ("--tracker", "ndi-emulator:", "--set", f"polaris_faults.{fault}")
    ended = ccr_host("track", long_path, *PAPERS, "--no-open", "--json", *words)
    assert ended.status == 3
    assert told in ended.summary["faults"][0]
    assert 0 < ended.summary["steps"] < 13, "the steps until then are kept"
    assert ended.summary["tracker_lost_steps"] >= 4
    assert ended.summary["coasted_steps"] >= 1
    assert ended.summary["held_steps"] >= 1


@pytest.mark.parametrize("fault", ["unplugged_s=[[2, 3]]", "reset_s=[2]"])
def test_a_run_continues_when_the_camera_returns_in_time(
    ccr_host: CcrHost, long_path: str, fault: str
) -> None:
    words = ("--set", f"polaris_faults.{fault}", "--set", "control.hold_s=9")
    summary = tracked(ccr_host, long_path, "ndi-emulator:", *words)
    assert summary["steps"] == 13
    assert summary["tracker_lost_steps"] > 0
    assert summary["faults"] == []


def test_monitor_shows_a_tracker_without_any_board(ccr_host: CcrHost) -> None:
    ended = ccr_host("monitor", "--tracker", "ndi-emulator:", "--duration", "5", "--json")
    assert ended.status == 0, ended.err
    seen = json.loads(ended.out)
    assert seen["health"]["tracking"]
    assert seen["link"] is None
    assert len(seen["markers_mm"]) == 3


def test_monitor_shows_a_board_too(ccr_host: CcrHost) -> None:
    ended = ccr_host("monitor", "--device", "emulator:", "--duration", "1", "--json")
    assert json.loads(ended.out)["link"]["state"] == "disarmed"


def test_a_camera_that_is_not_there_is_one_line(ccr_host: CcrHost) -> None:
    for command in (["monitor"], ["track", "8shape", *PAPERS], ["register"]):
        ended = ccr_host(*command, "--tracker", "ndi:/dev/nowhere")
        assert ended.status == 3
        assert "there is no such port" in ended.err.strip().splitlines()[-1]
        assert "Traceback" not in ended.err


@pytest.mark.parametrize("words", [["--polaris"], ["--polaris-tcp", "127.0.0.1:0"]])
def test_a_run_over_a_served_camera_that_sees_the_twin_of_the_served_board(
    ccr_host: CcrHost, short_path: str, words: list[str]
) -> None:
    server = ccr_host.start("emulate", *words)
    try:
        lines = [server.stdout.readline() for _ in range(3)]
        assert lines[1].startswith("emulated Polaris on ndi")
        uris = lines[2].split("8shape")[1].split()
        ended = ccr_host("track", short_path, *PAPERS, *IN_REAL_TIME, "--no-open", *uris, "--json")
    finally:
        server.send_signal(signal.SIGINT)
        server.communicate(timeout=PATIENCE_S)
    assert ended.status == 0, ended.err
    assert ended.summary["steps"] == 6
    assert ended.summary["mean_error_mm"] < 15, "the camera sees what the board moves"
    assert "true_mean_error_mm" not in ended.summary, "the host knows nothing of the twin"


@pytest.fixture
def long_path(tmp_path: Path) -> str:
    """Twelve seconds well inside the workspace."""
    file = tmp_path / "long.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n12,10,35\n")
    return str(file)


def assert_one_error(ended: Ended, named: str) -> None:
    assert ended.status == 3
    assert "Traceback" not in ended.err
    (error,) = [line for line in ended.err.splitlines() if line.startswith("ccr-host: error")]
    assert named in error


@pytest.mark.parametrize("kind", ["http", "closes at once"])
@pytest.mark.parametrize("scheme", ["igtl", "ndi+tcp"])
def test_a_foreign_server_on_the_trackers_port_is_one_line(
    ccr_host: CcrHost, scheme: str, kind: str
) -> None:
    with foreign_server(kind) as port:
        uri = f"{scheme}://127.0.0.1:{port}"
        ended = ccr_host("track", "8shape", *PAPERS, "--no-open", "--tracker", uri)
    assert_one_error(ended, uri)


@pytest.mark.parametrize("kind", ["http", "silence"])
def test_a_foreign_server_on_the_boards_port_is_one_line(ccr_host: CcrHost, kind: str) -> None:
    with foreign_server(kind) as port:
        uri = f"tcp://127.0.0.1:{port}"
        ended = ccr_host("track", "8shape", *PAPERS, "--no-open", "--device", uri)
    assert_one_error(ended, uri)


@pytest.mark.parametrize("command", [["track", "8shape", *PAPERS, "--no-open"], ["register"]])
def test_tool_files_that_are_exchanged_are_named_before_the_robot_moves_far(
    ccr_host: CcrHost, command: list[str]
) -> None:
    for name, stands_on in {"M1": "M3", "M2": "M2", "M3": "M1"}.items():
        rom = make_passive_rom(np.array(DUMMY_MARKERS_MM), f"CCR-{stands_on}")
        (ccr_host.folder / f"{name}.rom").write_bytes(rom)
    files = "tracker.tool_files={" + ", ".join(f'{m} = "{m}.rom"' for m in ("M1", "M2", "M3")) + "}"
    ended = ccr_host(*command, "--tracker", "ndi-emulator:", "--set", files)
    assert_one_error(ended, "markers M1 and M3 are exchanged")
