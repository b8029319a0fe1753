"""The client in matlab/, run by Octave: golden vectors, and an emulated board."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from ccr_host.core.clock import RealClock
from ccr_host.description import schema
from ccr_host.link.board_config import board_config
from ccr_host.link.messages import Capabilities
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.log.tables import arrays, tables_of
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.sim.board.board import SerialLine, UnoEmulator
from ccr_host.sim.serving.ports import TcpPort
from ccr_host.sim.serving.server import BoardServer
from tests.patience import PATIENCE_S
from tests.system.conftest import PAPERS, CcrHost
from tests.system.test_sockets import running

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "tests" / "matlab"


def octave(*words: str) -> str:
    """What a script prints."""
    program = shutil.which("octave-cli")
    if program is None:
        pytest.fail("there is no Octave: apt-get install octave octave-instrument-control")
    ended = subprocess.run(
        [program, "--no-init-file", "--path", str(ROOT / "matlab"), *words],
        capture_output=True, text=True, check=False, timeout=PATIENCE_S,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_octave_reads_and_writes_every_golden_vector() -> None:
    told = octave(str(SCRIPTS / "golden_vectors.m"), str(ROOT / "protocol" / "vectors.json"))
    vectors, frames = map(int, re.findall(r"\d+", told))
    assert vectors > 500
    assert frames > 500


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """URI of an emulated board over TCP."""
    host = CcrHost(tmp_path_factory.mktemp("board"))
    with emulated(host, "--tcp", "127.0.0.1:0") as uri:
        yield uri


@contextmanager
def emulated(ccr_host: CcrHost, *words: str) -> Iterator[str]:
    with running(ccr_host, "emulate", "--boot-ms", "100", *words) as process:
        assert process.stdout is not None
        yield process.stdout.readline().split()[3].rstrip(";")


def test_octave_arms_moves_and_stops_an_emulated_board_over_tcp(board: str) -> None:
    lines = octave(str(SCRIPTS / "drive.m"), board).splitlines()
    assert lines[1:] == [
        "before arming: the board refuses: bad_state",
        "setpoint 10 -20, pulses 1611 1278, active",
        "clamped to 85 0",
        "stopped, pulses 0 0",
        "disarmed",
    ]


def test_octave_drives_a_board_of_nine_axes_and_leaves_those_without_a_motor_at_rest(
    ccr_host: CcrHost,
) -> None:
    with emulated(ccr_host, "--robot", "three-spatial", "--tcp", "127.0.0.1:0") as uri:
        told = octave(
            "--eval",
            f"""
            robot = ccr.Client('{uri}');
            robot.configure();
            robot.arm();
            printf('%d axes, target', robot.identity.axes, robot.target([3 -4 5]));
            robot.close();
        """,
        )
    axes, *target = map(float, re.findall(r"-?\d+", told))
    assert axes == 9
    assert target == [3, -4, 5, 0, 0, 0, 0, 0, 0]


def test_a_board_of_older_firmware_is_not_sent_what_it_does_not_know(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ccr_host.sim.board.dispatch.CAPABILITIES", Capabilities.EEPROM)
    server = BoardServer(SerialLine(UnoEmulator()), TcpPort(0), RealClock(), boot_loader_us=0)
    with server:
        told = octave(
            "--eval",
            f"""
            robot = ccr.Client('{server.uri}');
            before = robot.request('get_counters');
            try
              robot.request('set_target_at');
            catch refused
              printf('%s: %s\\n', refused.identifier, refused.message);
            end
            after = robot.request('get_counters');
            printf('%d', after.nacks - before.nacks);
            robot.close();
        """,
        )
    refusal, nacks = told.splitlines()
    assert re.fullmatch(r"ccr:capability: .*does not know set_target_at: .*ccr-host flash", refusal)
    assert nacks == "0"


def test_a_board_that_has_only_just_started_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ccr_host.sim.board.safety.BOOT_TICKS", 50)  # 1 s instead of 0.1
    board = SerialLine(UnoEmulator())
    server = BoardServer(board, TcpPort(0), RealClock(), boot_loader_us=0)
    with server:
        octave("--eval", f"robot = ccr.Client('{server.uri}'); robot.close();")


def test_the_first_steps_end_where_the_board_says(board: str) -> None:
    told = octave("--eval", f"uri = '{board}'; first_steps")
    state, *numbers = re.findall(r"^\w+|-?\d+\.\d", told)
    q_deg, tip_mm = np.split(np.array(numbers, dtype=float), [2])
    assert state in ("active", "hold")
    expected = ConstantCurvature(schema.load(None).robot).tip_mm(np.radians(q_deg))
    assert tip_mm == pytest.approx(expected, abs=0.3)


def test_algorithm_1_follows_a_path_over_a_serial_port(ccr_host: CcrHost) -> None:
    with emulated(ccr_host) as uri:
        first_mm, mean_mm = map(float, octave(str(SCRIPTS / "follow.m"), uri).split())
    assert first_mm > 10
    assert mean_mm < 1, "the error of the motor's zero is fed back"


def test_the_clients_kinematics_are_those_of_the_host() -> None:
    q_rad = [[0.0, 0.0], [0.3, -0.2], [-1.1, 0.7]]
    told = octave("--eval", "".join(
        f"q = {row}'; printf('%.9g ', ccr.tip(q), ccr.jacobian(q)'); " for row in q_rad
    ))  # fmt: skip
    model = ConstantCurvature(schema.load(None).robot)
    expected = np.concatenate(
        [np.append(model.tip_mm(row), model.jacobian_mm_rad(row).ravel()) for row in q_rad]
    )
    assert np.array(told.split(), dtype=float) == pytest.approx(expected, abs=1e-4)


def test_the_clients_configuration_is_that_of_the_default_description(tmp_path: Path) -> None:
    script = tmp_path / "told.m"
    script.write_text("disp(jsonencode(ccr.default_config()))\n")
    told = json.loads(octave(str(script)))
    config = board_config(schema.load(None))
    assert set(told) == {"limits", "slew", "watchdog", "calibration", "acceleration"}
    for group, fields in told.items():
        for name, value in fields.items():
            assert tuple(np.atleast_1d(value)) == tuple(
                np.atleast_1d(getattr(getattr(config, group), name))
            )


def test_octave_reads_the_exported_tables(ccr_host: CcrHost, short_path: str) -> None:
    assert ccr_host("track", short_path, *PAPERS, "--no-open", "--out", "kept").status == 0
    ended = ccr_host("export", "kept", "--format", "mat", "--json")
    assert ended.status == 0, ended.err
    script = ccr_host.folder / "told.m"
    file = ccr_host.folder / "kept" / "tables" / "run.mat"
    script.write_text(
        f"s = load('{file}');\n"
        "for name = fieldnames(s)' printf('%s %d\\n', name{1}, numel(s.(name{1}).time_us)); end\n"
        "printf('%.9g ', s.steps.error_mm); disp('');\n"
        "printf('%s|', s.steps.outcome{:}); disp(s.events.text{end});\n"
    )
    *counts, errors, texts = octave(str(script)).splitlines()
    assert {name: int(count) for name, count in map(str.split, counts)} == ended.summary
    recording = RunRecording(ccr_host.folder / "kept")
    tables = {
        table.name: arrays(recording, table) for table in tables_of(recording.description.robot)
    }
    assert np.array(errors.split(), dtype=float) == pytest.approx(tables["steps"]["error_mm"])
    *outcomes, event = texts.split("|")
    assert outcomes == tables["steps"]["outcome"].tolist()
    assert event == tables["events"]["text"][-1]
