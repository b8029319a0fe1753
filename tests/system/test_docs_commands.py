"""Every command line that docs and --help print is run, hardware replaced by its simulation."""

from __future__ import annotations

import inspect
import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import tomlkit
import typer
from typer.core import TyperCommand, TyperGroup

from ccr_host.commands.app import app
from ccr_host.description.schema import Robot
from ccr_host.robot.kinematics import ConstantCurvature
from tests.conformance.firmware_build import firmware_elf
from tests.patience import PATIENCE_S
from tests.system.conftest import CcrHost
from tests.system.driven_terminal import DrivenTerminal

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *sorted((ROOT / "docs").rglob("*.md"))]
CLI = typer.main.get_command(app)
assert isinstance(CLI, TyperGroup)

SIMULATED = {
    r"serial:/dev/ttyACM0": "emulator:",
    r"ndi:/dev/ttyUSB0": "ndi-emulator:",
    r"runs/\S+": "kept",
    r"127\.0\.0\.1:\d+": "127.0.0.1:0",
    r"igtl://:\d+": "igtl://:0",
    r"examples/": f"{ROOT}/examples/",
    r"--device emulator:": "",
    r"--realtime": "",
    r"--view$": "--view 127.0.0.1:0",
    r"^(track|compare --path) (8shape|ellipse|star|helix)": r"\1 short.csv",
    r"^compare": "compare --path short.csv --controller mpc",
    r"^track(?=.*spatial)": "track --controller pid-ik",
    r"^track(?!.*spatial)": "track --controller mpc",
    r"^track": "track --no-open",
    r"^track(?!.*polaris_faults)": "track --unchecked",
    r"^compare(?!.*--unchecked)": "compare --unchecked",
    r"--controller adaptive": "--controller adaptive --set control.solver=compiled",
    r"--seed 1 --rate 1": "",
    r"--rate 20 +--view": "--view",
    r"(short.csv) --rate 20$": r"\1",
    r"--set twin.payload_g=5": "",
    r"--robot ideal --baselines": "--baselines",
    r"(my-robot.*) --view 127\S+": r"\1",
    r"^(calibrate .*) --tracker ndi-emulator:": r"\1",
    r"^record \S+": "record new.csv --pattern single",
    r"^monitor": "monitor --duration 4",
    r"^view": "view --address 127.0.0.1:0",
}
"""What stands for hardware, real time, minutes of work and addresses that may be taken; `mpc`, on
spatial robots `pid-ik`, for the default controller, which approaches its path for half a minute of
simulated time. A controller that is named comes later and counts. What another line shows too is
left out, so that both are one."""
TOLD_ELSEWHERE = {
    r"flash": "tests/firmware flashes a simulated UNO",
    r"tcp://127\.0\.0\.1:5025": "tests/system/test_emulate.py",
    r"simavr:": "tests/firmware runs the binary in simavr",
    r"sweep": "tests/system/test_sweep.py",
    r"setup": "tests/system/test_setup.py",
    r"--surface robot": "tests/unit/control/adaptive/test_surface.py",
    r"calibrate (--identify )?--robot": "tests/system/test_calibrate.py",
    r"register --robot": "tests/system/test_trackers.py",
}
HELP = {"--help", "-h", "--with-open"}
SERVES_UNTIL = {"emulate": "stdout", "view": "stderr"}
"""Commands that state that Ctrl-C ends them."""


def printed_lines(page: Path) -> list[str]:
    """Lines of indented code blocks, without comments and without what is said beside them."""
    blocks = re.findall(r"(?:^|\n) *\n((?: {4,}\S.*\n?)+)", page.read_text())
    lines = [line.split(" # ")[0].strip() for block in blocks for line in block.splitlines()]
    return [re.sub(r" {2,}.*", "", line) for line in lines]


def printed_commands() -> set[str]:
    return {
        line
        for page in PAGES
        for line in printed_lines(page)
        if line.startswith("ccr-host ") and not re.search(r"\b[A-Z]{3,}(\.elf)?$", line)
    }


def example_of(command: TyperCommand) -> str:
    told = inspect.cleandoc(command.help or "").split("Example: ")
    return " ".join(told[1].split("\n\n")[0].split()) if len(told) == 2 else ""


def simulated(command: str) -> str:
    words = command.removeprefix("ccr-host ")
    for hardware, simulation in SIMULATED.items():
        words = re.sub(hardware, simulation, words)
    return " ".join(words.split())


def to_be_run() -> list[str]:
    """One command of each group with the same effect."""
    commands = printed_commands() | {example_of(command) for command in CLI.commands.values()}
    here = {c for c in commands if not any(re.search(sign, c) for sign in TOLD_ELSEWHERE)}
    return sorted({simulated(command) for command in here if command})


@pytest.fixture(scope="module")
def recorded_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    write_short_path(folder)
    options = ("--no-open", "--controller", "mpc", "--out", "kept")
    assert CcrHost(folder)("track", "short.csv", *options).status == 0
    return folder / "kept"


@pytest.fixture
def at_work(ccr_host: CcrHost, recorded_run: Path) -> CcrHost:
    """A folder with the files that the docs describe."""
    # A fit takes 30 times as long in plain Python.
    (ccr_host.folder / "my-robot.toml").write_text(
        'name = "my robot"\n[control]\nsolver = "compiled"\n'
    )
    write_short_path(ccr_host.folder)
    write_rests(ccr_host.folder / "rests.csv")
    shutil.copytree(recorded_run, ccr_host.folder / "kept")
    return ccr_host


def write_short_path(folder: Path) -> None:
    (folder / "short.csv").write_text("t_s,y_mm,z_mm\n0,0,30\n3,6,33\n")


def write_rests(file: Path) -> None:
    """Rests of a robot as described, bent to and fro by both motors."""
    q_deg = 35.0 * np.sin(np.linspace(0.0, 12.0, 30)[:, None] * [1.0, 1.7])
    tip_mm = ConstantCurvature(Robot()).tip_mm(np.radians(0.8 * q_deg))
    rows = np.column_stack([np.arange(30.0), q_deg, tip_mm])
    header = "t_s,q1_deg,q2_deg,tip_x_mm,tip_y_mm,tip_z_mm"
    np.savetxt(file, rows, delimiter=",", header=header, comments="")


@pytest.mark.parametrize("line", to_be_run())
def test_a_printed_command_works(at_work: CcrHost, line: str) -> None:
    words = shlex.split(line)
    if words[0] == "jog" or "--by-eye" in words:
        assert_can_be_left_by_key(at_work, words)
    elif words[0] in SERVES_UNTIL:
        assert_serves_until_interrupted(at_work, words)
    else:
        ended = at_work(*words, timeout_s=300)
        assert ended.status == 0, ended.err


def assert_can_be_left_by_key(ccr_host: CcrHost, words: list[str]) -> None:
    terminal = DrivenTerminal(ccr_host.folder, *words)
    terminal.wait_for("board: (hold|active)")
    terminal.press("q")
    terminal.end()
    assert terminal.status == 0


def assert_serves_until_interrupted(ccr_host: CcrHost, words: list[str]) -> None:
    process = ccr_host.start(*words)
    said = getattr(process, SERVES_UNTIL[words[0]]).readline()
    assert "Ctrl-C ends" in said
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in err
    assert process.returncode in (0, 130)


def test_each_command_shows_an_example_of_itself() -> None:
    examples = {name: example_of(command) for name, command in CLI.commands.items()}
    assert {n for n, line in examples.items() if not line.startswith(f"ccr-host {n}")} == set()


def mentioned_commands() -> set[str]:
    """Commands between backquotes anywhere, and in code blocks."""
    told = [span for page in PAGES for span in re.findall(r"`(ccr-host [^`]+)`", page.read_text())]
    return {
        *told,
        *(line for page in PAGES for line in printed_lines(page) if line.startswith("ccr-host ")),
    }


def test_every_mentioned_command_has_the_options_mentioned() -> None:
    wrong = []
    for line in mentioned_commands():
        name, *words = line.removeprefix("ccr-host ").split()
        command = CLI.commands.get(name, CLI)
        given = {word.partition("=")[0] for word in words if word.startswith("--")}
        if (not name.startswith("-") and command is CLI) or given - options_of(command):
            wrong.append(line)
    assert not wrong


def options_of(command: TyperCommand) -> set[str]:
    parameters = command.get_params(typer.Context(command))
    return {option for p in parameters for option in (*p.opts, *p.secondary_opts)}


def test_other_programs_that_are_printed_are_there() -> None:
    project = tomlkit.parse((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    for page in PAGES:
        for line in printed_lines(page):
            first, _, rest = line.partition(" ")
            if first == "pip" and (wanted := re.search(r"ccr-host\[([^]]+)]", rest)):
                assert set(wanted[1].split(",")) <= set(extras), line
            elif first in {"python", "pytest", ".venv/bin/pytest"} or first.startswith("scripts/"):
                files = [w for w in line.split() if "/" in w and ":" not in w and w[0] != "."]
                assert all((ROOT / file.partition("::")[0]).exists() for file in files), line


def test_the_page_of_the_command_line_is_complete(recorded_run: Path) -> None:
    page = (ROOT / "docs" / "command-line.md").read_text()
    spans = " ".join(re.findall(r"`([^`]+)`", page))
    missing = {name for name in CLI.commands if not re.search(rf"\b{name}\b", spans)}
    options = set.union(*(options_of(command) for command in CLI.commands.values()))
    missing |= {option for option in options - HELP if option not in spans}
    metrics = json.loads((recorded_run / "run.json").read_text())["metrics"]
    missing |= {key for key in metrics if key not in spans and not key.startswith("true_")}
    assert not missing


def python_samples() -> list[tuple[str, str]]:
    """Blocks that begin with an import, by their page."""
    return [
        (page.stem, textwrap.dedent(block))
        for page in PAGES
        for block in re.findall(r"\n\n((?:(?: {4}.*)?\n)+)", page.read_text())
        if re.match(r"\s*(from|import) \w", block)
    ]


def test_every_python_sample_runs_on_a_short_path(tmp_path: Path) -> None:
    built = tmp_path / ".pio" / "build" / "uno" / "firmware.elf"
    built.parent.mkdir(parents=True)
    shutil.copy(firmware_elf(), built)
    write_short_path(tmp_path)
    samples = python_samples()
    assert {"README", "extending", "simavr"} <= {page for page, _ in samples}
    # In one process, as each would import the same; a path of 80 s takes 10 s in plain Python.
    each = [f"exec({sample.replace('8shape', 'short.csv')!r}, {{}})" for _, sample in samples]
    subprocess.run([sys.executable, "-c", "\n".join(each)], cwd=tmp_path, check=True)


def test_no_python_sample_hides_from_the_test_above() -> None:
    started = {page for page, _ in python_samples()}
    code = r"^ {4}(class|def|with|for|print|[a-z_.]+ = \w+\()\b"
    assert {page.stem for page in PAGES if re.search(code, page.read_text(), re.M)} <= started
