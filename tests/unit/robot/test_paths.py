"""The paper's paths and files of points, sampled for a controller."""

from __future__ import annotations

import os

import numpy as np
import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Robot, Servo
from ccr_host.description.schema import load as load_description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import PAPER_PATHS, load_path, path_names
from ccr_host.robot.workspace import MotorLimits, Workspace

MODEL = ConstantCurvature(Robot())
LIMITS = MotorLimits.of(Servo())


def load(name, rate_hz=1.0):
    return load_path(str(name), rate_hz, Workspace(MODEL, LIMITS))


def write(folder, text):
    file = folder / "p.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


@pytest.mark.parametrize(
    ("name", "steps", "unreachable", "worst_mm", "floor_mm"),
    [
        ("ellipse", 80, 22, 3.48, 0.663),
        ("8shape", 80, 0, 0.0, 0.0),
        ("star", 100, 8, 2.55, 0.139),
    ],
)
def test_paths_of_the_paper_at_its_rate(name, steps, unreachable, worst_mm, floor_mm):
    reference = load(name)
    assert len(reference) == steps
    assert reference.unreachable_steps == unreachable
    assert reference.unavoidable_mm.max() == pytest.approx(worst_mm, abs=0.005)
    assert reference.floor_mean_mm == pytest.approx(floor_mm, abs=0.001)


def test_targets_follow_equations_16_to_18():
    assert load("ellipse").target_mm[[0, 20], :][:, [0, 2]] == pytest.approx(
        np.array([[35.0, 0.0], [0.0, 45.0]]), abs=1e-9
    )
    eight = load("8shape").target_mm
    phase = np.pi * 50 / 40
    assert eight[0, [0, 2]] == pytest.approx([0.0, 48.0])
    assert eight[50, [0, 2]] == pytest.approx(
        [-48 * np.sin(phase) * np.cos(phase) ** 2, -48 * np.cos(phase) ** 2]
    )
    star = load("star").target_mm
    assert star[0, [0, 2]] == pytest.approx([0.0, 35.0])
    assert star[5, [0, 2]] == pytest.approx(
        [25 * (0.4 - np.sin(np.pi / 5)), 25 * np.cos(np.pi / 5)]
    )


@pytest.mark.parametrize("name", path_names())
@pytest.mark.parametrize("rate_hz", [0.5, 3.0, 20.0])
def test_rate_multiplies_the_samples_and_keeps_the_duration(name, rate_hz):
    slow, fast = load(name), load(name, rate_hz)
    assert len(fast) == round(len(slow) * rate_hz)
    assert fast.period_s == pytest.approx(1 / rate_hz)
    assert fast.time_s == pytest.approx(np.arange(len(fast)) / rate_hz)


@pytest.mark.parametrize("name", [*PAPER_PATHS, "swing"])
def test_third_coordinate_comes_from_the_model_at_the_nearest_configuration(name):
    reference = load(name, 5.0)
    tip = MODEL.tip_mm(reference.q_rad)
    assert reference.target_mm[:, 1] == pytest.approx(tip[:, 1])
    assert np.hypot(*(tip - reference.target_mm)[:, [0, 2]].T) == pytest.approx(
        reference.unavoidable_mm, abs=1e-9
    )


@pytest.mark.parametrize(
    ("robot", "name"),
    [
        ("single", "swing"),
        *[
            (robot, name)
            for robot in ("two-spatial", "three-spatial")
            for name in ("circle", "helix", "dome8", "letters")
        ],
    ],
)
def test_robots_reach_the_paths_of_their_kind_and_return_to_the_start(robot, name):
    description = load_description(robot)
    model, limits = ConstantCurvature(description.robot), MotorLimits.of(description.servo)
    reference = load_path(name, 2.0, Workspace(model, limits))
    assert reference.unreachable_steps == 0
    assert model.tip_mm(reference.q_rad) == pytest.approx(reference.target_mm, abs=0.01)
    steps_mm = np.linalg.norm(np.diff(reference.target_mm, axis=0), axis=1)
    gap_mm = np.linalg.norm(reference.target_mm[-1] - reference.target_mm[0])
    assert gap_mm < 1.5 * steps_mm.max()
    assert np.abs(np.diff(reference.q_rad, axis=0)).max() < np.radians(15.0)


def test_the_dome_is_what_one_arc_reaches():
    target_mm = load("dome8").target_mm
    length_mm = sum(MODEL.lengths_mm)
    aside_mm = np.hypot(target_mm[:, 0], target_mm[:, 2])
    bend_rad = 2.0 * np.arctan2(aside_mm, -target_mm[:, 1])
    arc_mm = np.where(bend_rad > 0, bend_rad * np.hypot(aside_mm, target_mm[:, 1]), 0.0)
    chord = 2.0 * np.sin(bend_rad / 2.0)
    bent = bend_rad > 1e-3
    assert arc_mm[bent] / chord[bent] == pytest.approx(length_mm)


def test_file_is_resampled_linearly_from_its_first_row(tmp_path):
    file = write(tmp_path, "t_s,y_mm,z_mm\n10,0,0\n12,4,-8\n13,4,0\n")
    reference = load(file, 2.0)
    assert reference.name == "p"
    assert reference.time_s == pytest.approx([0, 0.5, 1, 1.5, 2, 2.5, 3])
    assert reference.target_mm[:, 0] == pytest.approx([0, 1, 2, 3, 4, 4, 4])
    assert reference.target_mm[:, 2] == pytest.approx([0, -2, -4, -6, -8, -4, 0])
    assert reference.target_mm[:, 1] == pytest.approx(MODEL.tip_mm(reference.q_rad)[:, 1])


def test_file_may_give_the_third_coordinate_and_any_column_order(tmp_path):
    file = write(tmp_path, "\ufeff x_mm , z_mm,y_mm,t_s\r\n-90,1,2,0\r\n\r\n-100,3,4,1\r\n")
    reference = load(file)
    assert reference.target_mm == pytest.approx(np.array([[2, -90, 1], [4, -100, 3]]))


@pytest.mark.parametrize(
    "text",
    [
        "t_s;y_mm;z_mm\n0;1,5;-2\n1;3;4,25\n",
        "t_s\ty_mm\tz_mm\n0\t1.5\t-2\n1\t3\t4.25\n",
        "t_s y_mm  z_mm\n0 1.5 -2\n 1  3 4.25\n",
        "# drawn by hand\n\nt_s, y_mm, z_mm  # as ever\n0,1.5,-2 # start\n1,3,4.25\n# end\n",
        "# t_s,y_mm,z_mm\n0.0e+00,1.5e+00,-2.0\n1.0,3.0,4.25\n",
        "% t_s y_mm z_mm\n0 1.5 -2\n1 3 4.25\n",
        "T_S, Y_mm, Z_MM\n0,1.5,-2\n1,3,4.25\n",
        '"t_s" , "y_mm", "z_mm"\n"0","1.5","-2"\n"1","3","4.25"\n',
        '"t_s","y_mm","z_mm"\n"0","1,5","-2"\n"1","3","4,25"\n',
        "sep=;\nt_s;y_mm;z_mm\n0;1,5;-2\n1;3;4,25\n",
        "t_s,y_mm,z_mm,,\n0,1.5,-2,,\n1,3,4.25\n",
        "t_s;y_mm;z_mm\n;;\n0;1,5;-2\n1;3;4,25\n;;\n ; ;\n",
        "t_s,y_mm,z_mm\r0,1.5,-2\r1,3,4.25\r",
        "t_s,y_mm,z_mm\r\n0,1.5,-2\r\n1,3,4.25",
        "\ufefft_s,y_mm,z_mm\n0,1.5,-2\n1,3,4.25\n",
        "t_s,y_mm,z_mm\n0,1.5,-2\n1,3,4.25\n".encode("utf-16"),
        "t_s,y_mm,z_mm\n0,1.5,-2\n1,3,4.25\n".encode("utf-32"),
        "t_ms,y_mm,z_cm\n0,1.5,-0.2\n1000,3,0.425\n",
        "time (ms), y (m), z [mm]\n0,0.0015,-2\n1000,0.003,4.25\n",
        "Time [s];y_µm;z\u00a0(mm)\n0;1500;\N{MINUS SIGN}2\n1;3000;4,25\n",
    ],
)
def test_a_table_that_can_mean_one_thing_only_is_read(tmp_path, text):
    reference = load(write(tmp_path, text))
    assert reference.time_s == pytest.approx([0, 1])
    assert reference.target_mm[:, [0, 2]] == pytest.approx(np.array([[1.5, -2], [3, 4.25]]))


@pytest.mark.parametrize(
    ("text", "question"),
    [
        ("t_s,y_mm,z_mm\n0,0,0.03\n3,0.01,0.035\n", "metres"),
        ("t_s,y_mm,z_mm,x_mm\n0,0,0.03,-0.09\n3,0.01,0.035,-0.1\n", "metres"),
        ("t_s,y_mm,z_mm\n0,0,30\n1000,5,32\n2000,10,35\n3000,12,35\n", "milliseconds"),
        ("time [s]\ty (mm)\tz (mm)\n0\t0\t30\n50\t0,2\t30\n100\t0,4\t30\n", "milliseconds"),
    ],
)
def test_units_that_make_no_sense_are_asked_for(tmp_path, text, question):
    with pytest.raises(ConfigError, match=rf"are these {question}\?.*(y_m|t_ms)"):
        load(write(tmp_path, text))


@pytest.mark.long
@pytest.mark.parametrize(
    "text",
    [
        "t_s,y_mm,z_mm\n0,0,0\n3600,0,0\n",
        "t_s,y_mm,z_mm\n0,0,30\n86400,0,30\n",
        "t_s,y_mm,z_mm\n0,0,30\n60,10,35\n",
        "t_s,y_um,z_um\n0,0,0\n5,100,50\n",
        "t_min,y_mm,z_mm\n0,0,30\n60,1,30\n",
    ],
)
def test_a_pose_that_is_held_and_a_slow_or_small_path_on_purpose_are_not(tmp_path, text):
    assert len(load(write(tmp_path, text), 0.5)) > 1


def test_a_file_too_long_is_refused_at_once_and_says_so(tmp_path):
    file = tmp_path / "p.csv"
    with file.open("wb") as sparse:
        sparse.truncate(300_000_000)
    with pytest.raises(ConfigError, match=r"longer than 40 MB"):
        load(file)


def test_a_title_is_short_printable_and_not_that_of_a_built_in_path(tmp_path):
    rows = HEADER + "0,1,2\n1,2,3\n"
    for name, title in (
        ("a\nb$x_1$.csv", r"a\nb$x_1$"),
        ("x" * 250 + ".csv", "x" * 60 + "..."),
        ("-dashed.csv", "-dashed"),
        (os.fsdecode(b"\xff[bold]"), r"\udcff[bold]"),
        ("star.csv", "star (file)"),
        ("star", "star (file)"),
    ):
        (tmp_path / name).write_text(rows)
        assert load(tmp_path / name).name == title


def test_file_with_the_samples_of_a_built_in_path_gives_the_same_reference(tmp_path):
    star = load("star")
    rows = zip(star.time_s, star.target_mm[:, 0], star.target_mm[:, 2], strict=True)
    text = "t_s,y_mm,z_mm\n" + "\n".join(f"{t!r},{y!r},{z!r}" for t, y, z in rows)
    copy = load(write(tmp_path, text.replace("np.float64(", "").replace(")", "")))
    assert copy.target_mm == pytest.approx(star.target_mm)
    assert copy.q_rad == pytest.approx(star.q_rad)


HEADER = "t_s,y_mm,z_mm\n"


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("t_s,y_mm\n0,1\n1,2\n", 1, "z_mm"),
        ("t_s,y_mm,z_mm,w\n0,1,2,3\n1,2,3,4\n", 1, "'w'"),
        ("t_s,y_mm,z_mm,z_mm\n0,1,2,3\n1,2,3,4\n", 1, "repeated"),
        ("time;y;z\n0;1;2\n1;2;3\n", 1, "'time' has no unit"),
        ("t_s,y_in,z_in\n0,1,2\n1,2,3\n", 1, "the unit 'in'"),
        ("a,b,c\n0,1,2\n1,2,3\n", 1, "'a', 'b', 'c'"),
        ("t_s;y_mm;z_mm\n0;1,5;2\n1;2.5;3\n", 3, "'2.5'"),
        ("t_s;y_mm;z_mm\n0;1;2\n1;1.234,5;3\n", 3, "'1.234,5'"),
        ("t_s,y_mm,z_mm\n0,0,1,5,2,0\n1,0,2,5,3,0\n", 2, "6 values for 3"),
        ("0,1,2\n1,2,3\n", 1, "t_s"),
        (HEADER + "0,1,2\n1,nan,3\n", 3, "y_mm"),
        (HEADER + "0,1,2\n1,2,-inf\n", 3, "z_mm"),
        (HEADER + "0,1,2\n\n1,2,1e999\n", 4, "z_mm"),
        (HEADER + "0,1,2\n1,two,3\n", 3, "'two'"),
        (HEADER + "0,1,2\n1,1_0,3\n", 3, "'1_0'"),
        (HEADER + "0,1,2\n1,,3\n", 3, "y_mm"),
        (HEADER + "0,1,2\n1,2\n", 3, "2 values"),
        (HEADER + "0,1,2\n1,2,3,4\n", 3, "4 values"),
        (HEADER + "0,1,2\n0,2,3\n", 3, "increase"),
        (HEADER + "0,1,2\n2,2,3\n1,2,3\n", 4, "increase"),
        (HEADER + '0,1,2\n1,"2,3\n', 3, ""),
        (HEADER + "0,1,2\n1," + "9" * 500 + "x,3\n", 3, "..."),
    ],
)
def test_bad_line_is_named_with_file_line_and_cure(tmp_path, text, line, words):
    file = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load(file)
    assert f"{file}, line {line}:" in caught.value.cause
    assert words in caught.value.cause
    assert caught.value.cure
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(file))


@pytest.mark.parametrize(
    ("number", "cure"),
    [
        ("1,000.5", "without marks between the thousands"),
        ("1.234,5", "without marks between the thousands"),
        ("1.234.567", "without marks between the thousands"),
        ("2,5", "the same decimal mark"),
        ("2.5mm", "nothing else"),
    ],
)
def test_an_error_in_a_number_is_reported(tmp_path, number, cure):
    with pytest.raises(ConfigError) as caught:
        load(write(tmp_path, f't_s;y_mm;z_mm\n0;1.5;2\n1;"{number}";3\n'))
    assert cure in caught.value.cure


def test_a_coordinate_beyond_all_robots_is_refused(tmp_path):
    for far in ("1e308", "-1e200", "100001"):
        with pytest.raises(ConfigError, match="which no robot reaches"):
            load(write(tmp_path, HEADER + f"0,1,2\n1,2,{far}\n2,3,4\n"))


def test_a_spreadsheet_is_called_by_its_name(tmp_path):
    with pytest.raises(ConfigError, match=r"a spreadsheet \(.xlsx.*give a text file"):
        load(write(tmp_path, b"PK\x03\x04\x14\0\6\0" + bytes(range(256))))


def test_text_in_an_old_code_page_is_asked_for_in_utf_8(tmp_path):
    with pytest.raises(ConfigError, match="save it as UTF-8"):
        load(write(tmp_path, ("# Stra\u00dfe\n" + HEADER + "0,1,2\n1,2,3\n").encode("cp1252")))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\n\n",
        HEADER,
        HEADER + "0,1,2\n",
        b"\xff\xfe\x00\x01",
        b"\x00" * 64,
        "t_s,y_mm,z_mm\n0,0,0\n0.5,1,1\n",
        "t_s,y_mm,z_mm\n0,0,0\n1e300,1,1\n",
        "t_s,y_mm,z_mm\n-1e308,0,0\n1e308,1,1\n",
    ],
    ids=[
        "empty",
        "blank",
        "no row",
        "one row",
        "binary",
        "zeros",
        "too short",
        "too long",
        "range",
    ],
)
def test_file_without_a_usable_path_is_refused(tmp_path, text):
    file = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load(file)
    assert "p" in caught.value.cause
    assert caught.value.cure
    assert "\n" not in str(caught.value)


def test_missing_file_folder_and_impossible_name_are_refused(tmp_path):
    for name in (tmp_path / "no.csv", tmp_path, "a\0b.csv", "x" * 300 + ".csv"):
        with pytest.raises(ConfigError, match="path file"):
            load(name)


def test_unknown_name_lists_the_known_ones():
    with pytest.raises(ConfigError) as caught:
        load("elipse")
    assert all(name in caught.value.cure for name in path_names())


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan"), float("inf"), 1e9, 1e-3, 1e300])
def test_rate_that_gives_no_sensible_path_is_refused(rate_hz):
    with pytest.raises(ConfigError) as caught:
        load("star", rate_hz)
    assert caught.value.cure


def test_far_targets_get_finite_references(tmp_path):
    file = write(tmp_path, HEADER + "0,1e5,-1e5\n1,-9e4,3\n2,0,1e4\n")
    reference = load(file)
    assert np.all(np.isfinite(reference.q_rad))
    assert reference.unreachable_steps == 3
