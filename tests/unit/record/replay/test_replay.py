"""Runs of many kinds, executed again on their own logs."""

from dataclasses import dataclass, replace
from itertools import count

import numpy as np
import pytest

from ccr_host.core.clock import RealClock, VirtualClock
from ccr_host.core.errors import ConfigError
from ccr_host.description.file import keep_in
from ccr_host.description.schema import Description
from ccr_host.link.client import Client
from ccr_host.link.framing import decode_single_frame, encode_frame
from ccr_host.link.messages import Fault, SetTarget, Stop, TargetReply
from ccr_host.record.keep import execute_logged
from ccr_host.record.log import topics
from ccr_host.record.log.reader import LogEnd, RunRecording
from ccr_host.record.log.run_log import RunLog
from ccr_host.record.replay import replay
from ccr_host.record.report import read_run
from ccr_host.run.execute import reference_of
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import summarise
from ccr_host.sim.board.board import SerialLine, UnoEmulator
from ccr_host.sim.board.eeprom import EepromImage
from ccr_host.sim.serving.ports import TcpPort
from ccr_host.sim.serving.server import BoardServer
from ccr_host.tools.equipment import EquipmentChange, change_equipment
from tests.faulty_line import FaultyLine, LineNoise
from tests.unit.control.adaptive.test_surface import SHORTER_MM, identified_as_short
from tests.unit.record.replay.rewrite import rewritten

SEED = 3
QUICK = ("control.settle_s=0", "link.arm_axis_ms=20", "link.relax_after_ms=60000")


@dataclass
class Buttons:
    """An operator who does something at a step, and asks no more than the run does."""

    pause_at: int | None = None
    stop_at: int | None = None
    asked: int = 0
    step: int = -1

    @property
    def wants_pause(self) -> bool:
        self.asked += self.step == self.pause_at
        return self.step == self.pause_at and self.asked < 4

    @property
    def wants_stop(self) -> bool:
        return self.step == self.stop_at

    def news(self) -> str:
        return "the page was lost" if self.step == 5 else ""

    def on_step(self, step, steps, record) -> None:
        self.step = step


def run(
    folder, path, *overrides, controller="mpc", on_step=lambda *_: None, operator=None, **options
):
    options = RunOptions(path, controller, seed=SEED, overrides=overrides, **options)
    return execute_logged(options, folder, on_step, operator=operator)


def sent_frames(recording):
    return [message.content["hex"] for message in recording.messages(topics.SENT)]


def assert_equal(folder, steps):
    recording = RunRecording(folder)
    result = replay(recording)
    assert result.difference is None
    assert result.frames == len(sent_frames(recording))
    assert result.steps == steps


@pytest.mark.long
@pytest.mark.parametrize("controller", ["mpc", "open-loop"])
def test_a_run_in_virtual_time_repeats_byte_for_byte(folder, short_path, controller):
    result = run(folder, short_path, controller=controller)
    assert result.failure is None
    assert_equal(folder, steps=4)


@pytest.mark.long
def test_laps_of_adaptive_repeat_byte_for_byte(folder, tmp_path):
    file = tmp_path / "loop.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,50\n2,4,50\n4,4,46\n6,0,46\n8,0,50\n")
    fast = "control.solver=compiled"
    result = run(folder, str(file), fast, controller="adaptive", laps=3)
    assert result.failure is None
    assert RunRecording(folder).reference.laps == 3
    assert_equal(folder, steps=24)


@pytest.mark.long
def test_a_replay_takes_the_surface_that_was_fixed_before_the_run(folder, short_path, tmp_path):
    robot, out = str(tmp_path / "mine.toml"), tmp_path / "mine.toml"
    rests = identified_as_short().model_dump(include={"identified"}, exclude_none=True)
    keep_in(out, rests, None)
    result = run(folder, short_path, robot=robot, surface="robot")
    assert result.failure is None
    assert summarise(result)["surface"] == RunRecording(folder).options.surface == "robot"
    assert read_run(folder).title == "short, mpc, 1 Hz, on the surface of the robot"
    out.unlink()
    recorded, described = RunRecording(folder).reference, reference_of(RunOptions(short_path))
    assert np.array_equal(recorded.target_mm, result.reference.target_mm)
    assert np.all(recorded.target_mm[:, 1] > described.target_mm[:, 1] + SHORTER_MM)
    assert_equal(folder, steps=4)


@pytest.mark.long
def test_a_run_in_real_time_repeats_byte_for_byte(folder, short_path):
    result = run(folder, short_path, *QUICK, realtime=True, rate_hz=10.0)
    assert result.failure is None
    assert_equal(folder, steps=31)


@pytest.mark.long
@pytest.mark.parametrize(
    "overrides", [("tracker.dropout=0.9",), ("tracker.rotation_deg=3", "twin.friction=0.2")]
)
def test_so_does_one_with_a_poor_camera_or_robot(folder, short_path, overrides):
    run(folder, short_path, *overrides, rate_hz=10.0)
    assert_equal(folder, steps=31)


@pytest.mark.long
def test_so_does_one_through_the_polaris_emulator_and_its_frames_are_logged(folder, short_path):
    result = run(folder, short_path, tracker="ndi-emulator:", rate_hz=5.0)
    assert result.failure is None
    assert_equal(folder, steps=16)
    frames = list(RunRecording(folder).messages(topics.MARKER_FRAME))
    assert len(frames) > 3 * 15
    assert all(len(frame.content["points_mm"]) >= 2 for frame in frames[-10:])


@pytest.fixture
def lines(monkeypatch):
    """The lines to the emulated boards of the runs to come."""
    made = []

    def make(board):
        made.append(FaultyLine(board))
        return made[-1]

    monkeypatch.setattr("ccr_host.run.open_rig.SerialLine", make)
    return made


def inject_fault(line):
    line.board.inject_fault(Fault.TICK_OVERRUN)


def unplug(line):
    line.unplug()


def interrupt(line):
    raise KeyboardInterrupt


@pytest.mark.long
@pytest.mark.parametrize(
    ("trouble", "realtime"),
    [(inject_fault, False), (unplug, False), (interrupt, False), (interrupt, True)],
)
def test_so_does_one_that_was_ended_half_way(folder, short_path, lines, trouble, realtime):
    def on_step(step, steps, record):
        if step == 12:
            trouble(lines[0])

    result = run(folder, short_path, *QUICK, rate_hz=10.0, realtime=realtime, on_step=on_step)
    assert result.failure is not None
    assert_equal(folder, steps=len(result.records))


@pytest.mark.parametrize(
    "nobody", [{"device": "tcp://127.0.0.1:1"}, {"tracker": "ndi+tcp://127.0.0.1:1"}]
)
def test_so_does_one_that_found_no_board_or_no_camera(folder, short_path, nobody, monkeypatch):
    begin = RunLog.begin

    def begin_and_start(log, setup):  # as version 0.1 did; now a start that fails leaves no log
        begin(log, setup)
        log._start()

    monkeypatch.setattr(RunLog, "begin", begin_and_start)
    result = run(folder, short_path, **nobody)
    assert "refused" in str(result.failure)
    assert replay(RunRecording(folder)).difference is None


@pytest.mark.long
def test_so_does_one_on_a_board_that_was_asked_for_its_name(folder, short_path):
    eeprom, clock = EepromImage(), VirtualClock()
    line = SerialLine(UnoEmulator(eeprom))
    clock.attach(line)
    with Client(line, clock, 1) as client:
        client.connect()
        change_equipment(client, Description(), EquipmentChange(board_name="left arm"))
    board = SerialLine(UnoEmulator(eeprom))
    server = BoardServer(board, TcpPort(0), RealClock(), boot_loader_us=0)
    with server:
        overrides = (*QUICK, "robot.board_name=left arm")
        result = run(folder, short_path, *overrides, device=server.uri, tracker="twin:")
    assert result.failure is None
    assert_equal(folder, steps=len(result.records))


def test_so_does_one_over_a_noisy_line(folder, short_path, lines):
    def on_step(step, steps, record):
        lines[0].noise = LineNoise(np.random.default_rng(1), drop=0.002, flip=0.002)

    result = run(folder, short_path, rate_hz=10.0, on_step=on_step)
    assert result.link.crc_errors > 0
    assert_equal(folder, steps=len(result.records))


@pytest.mark.long
@pytest.mark.parametrize("buttons", [Buttons(pause_at=10), Buttons(stop_at=20)])
def test_so_does_one_with_an_operator_at_its_buttons(folder, short_path, buttons):
    result = run(folder, short_path, rate_hz=10.0, on_step=buttons.on_step, operator=buttons)
    sent = [message.content["name"] for message in RunRecording(folder).messages(topics.SENT)]
    assert (Stop.NAME in sent) == (buttons.stop_at is not None)
    assert_equal(folder, steps=len(result.records))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, short_path):
    made = tmp_path_factory.mktemp("recorded")
    run(made, short_path, rate_hz=10.0)
    return made


def changed(topic, index, change):
    """Change the content of one message on a topic."""
    seen = 0

    def apply(message):
        nonlocal seen
        content = message.content
        if message.topic == topic.name:
            seen += 1
            if seen == index + 1:
                return change(content)
        return content

    return apply


def test_writing_a_log_again_changes_nothing(recorded, tmp_path):
    copy = rewritten(recorded, tmp_path, lambda message: message.content)
    assert replay(copy).difference is None


def first_used_sample(recorded):
    """Index of the sample that was measured at the end of step 0."""
    step = next(RunRecording(recorded).messages(topics.STEP)).content
    samples = [m.content["markers_mm"] for m in RunRecording(recorded).messages(topics.SAMPLE)]
    tips_mm = [np.subtract(m3, m1).tolist() for m1, _, m3 in samples]
    return tips_mm.index(step["measured_mm"])


def test_a_sample_that_was_tampered_with_is_found(recorded, tmp_path):
    def move(content):
        m1, m2, m3 = content["markers_mm"]
        return {**content, "markers_mm": [m1, m2, [m3[0], m3[1], m3[2] + 2.0]]}

    moved = changed(topics.SAMPLE, first_used_sample(recorded), move)
    difference = replay(rewritten(recorded, tmp_path, moved)).difference
    assert difference is not None
    assert "SetTarget" in difference.what
    assert difference.steps_done == 1, "the first command that rests on that sample"


@pytest.mark.parametrize("topic", [topics.SENT, topics.RECEIVED])
def test_a_frame_that_was_tampered_with_is_found(recorded, tmp_path, topic):
    frames = [m.content for m in RunRecording(recorded).messages(topic)]
    kind = SetTarget if topic is topics.SENT else TargetReply
    index = [content["name"] for content in frames].index(kind.NAME, len(frames) // 2)
    frame = decode_single_frame(bytes.fromhex(frames[index]["hex"]))
    first, second = kind.unpack(frame.payload).target_cdeg
    other = replace(kind.unpack(frame.payload), target_cdeg=(first + 300, second))
    data = encode_frame(frame.id, frame.sequence, other.pack())
    tampered = rewritten(
        recorded, tmp_path, changed(topic, index, lambda content: {**content, "hex": data.hex()})
    )
    difference = replay(tampered).difference
    assert difference is not None
    assert "SetTarget" in difference.what


@pytest.mark.parametrize("topic", [topics.SENT, topics.RECEIVED, topics.INPUTS, topics.SAMPLE])
def test_a_message_that_was_left_out_is_found(recorded, tmp_path, topic):
    is_sample = topic is topics.SAMPLE
    count = len(list(RunRecording(recorded).messages(topic)))
    index = first_used_sample(recorded) if is_sample else count // 2
    without = rewritten(recorded, tmp_path, changed(topic, index, lambda _: None))
    difference = replay(without).difference
    assert difference is not None
    if is_sample:
        assert "sample that is not in the log" in difference.what, "the cause, not its effect"


def test_a_log_cut_short_is_compared_as_far_as_it_goes(recorded, tmp_path):
    whole = (recorded / "log_0000.mcap").read_bytes()
    (tmp_path / "log_0000.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    cut = RunRecording(tmp_path)
    result = replay(cut)
    assert not cut.end.is_complete
    assert result.difference is None
    assert 0 < result.frames < len(sent_frames(RunRecording(recorded)))


def test_frames_beyond_the_end_of_a_killed_runs_tape_are_not_compared(recorded, tmp_path):
    pieces = len(list(RunRecording(recorded).messages(topics.INPUTS)))
    kept = count()

    def without_the_last_pieces(message):
        beyond = message.topic == topics.INPUTS.name and next(kept) >= pieces // 2
        return None if beyond else message.content

    cut = rewritten(recorded, tmp_path, without_the_last_pieces, trouble="killed")
    result = replay(cut)
    assert result.difference is None
    assert 0 < result.frames < len(sent_frames(cut))


def test_a_damaged_log_is_refused_as_such(recorded, tmp_path):
    data = bytearray((recorded / "log_0000.mcap").read_bytes())
    data[data.rindex(b"zstd", 0, len(data) // 3) + 500] ^= 1
    (tmp_path / "log_0000.mcap").write_bytes(data)
    with pytest.raises(ConfigError, match=r"log is damaged: bytes .* messages were lost") as caught:
        replay(RunRecording(tmp_path))
    assert caught.value.exit_status == 2


@pytest.mark.parametrize("tokens", ["w?", "wwwwwwww", "x", "\u00e9"])
def test_a_tape_that_makes_no_sense_is_refused(recorded, tmp_path, tokens):
    odd = changed(topics.INPUTS, 3, lambda content: {**content, "tokens": tokens})
    with pytest.raises(ConfigError, match="messages on /run/inputs"):
        replay(rewritten(recorded, tmp_path, odd))


def test_the_tape_of_version_0_1_is_refused_and_its_version_named(recorded, tmp_path):
    old = changed(topics.INPUTS, 3, lambda content: {**content, "tokens": "rrtfrw=rs"})
    with pytest.raises(ConfigError, match=r"written by ccr-host .*, with messages on /run/inputs"):
        replay(rewritten(recorded, tmp_path, old))


def test_a_log_with_gaps_is_refused(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr(RunRecording, "end", LogEnd(is_complete=True, lost_messages=7))
    with pytest.raises(ConfigError, match="7 messages were lost"):
        replay(RunRecording(recorded))
