"""Files of measurements: what is read, and one clear line for what cannot be."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.tools.measured import read_measured

HEADER = "t_s,q1_deg,q2_deg,tip_x_mm,tip_y_mm,tip_z_mm"
ROWS = [f"{0.5 * n},{n},{-n},{n},2,3" for n in range(24)]


def written(folder: Path, header: str = HEADER, rows: list[str] = ROWS) -> Path:
    file = folder / "rests.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


def test_units_are_those_of_the_header(tmp_path):
    measured = read_measured(written(tmp_path, "t_ms,q1_deg,q2_rad,tip_x_m,tip_y_mm,tip_z_cm"))
    assert measured.unit == "rad"
    assert measured.time_s[1] == pytest.approx(5e-4)
    assert measured.command[3] == pytest.approx([math.radians(3), -3.0])
    assert measured.tip_mm[3] == pytest.approx([3000.0, 2.0, 30.0])
    since_1970 = [f"{1_790_000_000 + n},{n},{-n},{n},2,3" for n in range(30)]
    assert read_measured(written(tmp_path, HEADER, since_1970)).time_s[3] == 1_790_000_003.0
    travel = read_measured(written(tmp_path, HEADER.replace("deg", "mm")))
    assert travel.unit == "mm"
    assert travel.command[3] == pytest.approx([3.0, -3.0])


def test_pattern_and_middle_are_read_and_may_be_missing(tmp_path):
    header = f"pattern,{HEADER},middle_x_mm,middle_y_mm,middle_z_mm"
    rows = [f"up,{row},1,2,{'nan' if n else '3'}" for n, row in enumerate(ROWS)]
    measured = read_measured(written(tmp_path, header, rows))
    assert measured.pattern.tolist() == ["up"] * 24
    assert measured.below_mm[0] == pytest.approx(np.array([[1, 2, 3]]))
    assert np.isnan(measured.below_mm[1, 0, 2])
    plain = read_measured(written(tmp_path))
    assert set(plain.pattern.tolist()) == {""}
    assert plain.below_mm.shape == (24, 0, 3)


def test_markers_below_the_tip_are_the_ends_of_the_other_segments(tmp_path):
    header = f"{HEADER},m3_x_mm,m3_y_mm,m3_z_mm"
    measured = read_measured(written(tmp_path, header, [f"{row},1,2,3" for row in ROWS]))
    ends_mm = measured.ends_mm(4)
    assert ends_mm[:, 1] == pytest.approx(np.tile([1.0, 2.0, 3.0], (24, 1)))
    assert ends_mm[:, 3] == pytest.approx(measured.tip_mm)
    assert np.isnan(ends_mm[:, [0, 2]]).all()
    with pytest.raises(ConfigError, match=r"marker m3 .* has 2 segments"):
        measured.ends_mm(2)


def test_middle_is_another_name_of_m2(tmp_path):
    header = f"{HEADER},middle_x_mm,m2_x_mm"
    with pytest.raises(ConfigError, match="m2_x is there twice"):
        read_measured(written(tmp_path, header, [f"{row},1,2" for row in ROWS]))


@pytest.mark.parametrize(
    ("change", "comment"),
    [
        (lambda line: line.replace(",", ";").replace(".", ","), ""),
        (lambda line: line.replace(",", "\t"), "sep=\t\n"),
        (lambda line: line.replace(",", " ").replace("_deg", "_DEG"), "# of Monday\n"),
        (lambda line: line.replace("_mm", " (mm)"), "\n"),
    ],
)
def test_tables_of_spreadsheets_and_scripts_are_read_as_paths_are(tmp_path, change, comment):
    plain = read_measured(written(tmp_path))
    changed = read_measured(written(tmp_path, comment + change(HEADER), [*map(change, ROWS)]))
    assert changed.unit == "rad"
    assert np.array_equal(changed.time_s, plain.time_s)
    assert np.array_equal(changed.command, plain.command)
    assert np.array_equal(changed.tip_mm, plain.tip_mm)


BROKEN_ROW = [*ROWS[:5], "2.5,nan,1,1,2,3", *ROWS[6:]]


@pytest.mark.parametrize(
    ("header", "rows", "cause"),
    [
        (HEADER.replace("tip_z_mm", "pattern"), ROWS, "no column tip_z"),
        (HEADER.replace("t_s", "pattern"), ROWS, "no column t,"),
        (HEADER.replace("q2_deg", "q3_deg"), ROWS, "no column q2"),
        (HEADER.replace("q", "motor"), ROWS, "unknown column 'motor1_deg'"),
        (HEADER.replace("q1_deg", "q1"), ROWS, "column 'q1' has no unit"),
        (HEADER.replace("q1_deg", "q1_turns"), ROWS, "the unit 'turns'"),
        (HEADER.replace("tip_x_mm", "tip_x"), ROWS, "column 'tip_x' has no unit"),
        (HEADER.replace("q1_deg", "q1_mm"), ROWS, "q1 is tendon travel, but others are angles"),
        (HEADER.replace("q2_deg", "q1_rad"), ROWS, "q1 is there twice"),
        (HEADER, ROWS[:7], "7 rows"),
        (HEADER, [], "0 rows"),
        (HEADER, BROKEN_ROW, "line 7: q1_deg = 'nan'"),
        (HEADER, [*ROWS, "99,1,2,3,4"], "line 26: 5 values for 6 columns"),
        (HEADER, [*ROWS, ROWS[-1]], "line 26: the time does not increase"),
        (HEADER, [f"{n},{n},7,1,2,3" for n in range(30)], "q2 never changes"),
        (HEADER, [f"{n},{n},x,1,2,3" for n in range(30)], "line 2: q2_deg = 'x'"),
        (HEADER, [*ROWS, "99,1,2,1e308,2,3"], "line 26: tip_x_mm = '1e308', which no robot"),
        (HEADER, [*ROWS, "99,1e6,2,1,2,3"], "line 26: q1_deg = '1e6', which no robot"),
        (HEADER.replace("tip_z_mm", "tip_z_m"), [*ROWS, "99,1,2,1,2,300"], "tip_z_m = '300'"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_in_one_line(tmp_path, header, rows, cause):
    with pytest.raises(ConfigError) as refused:
        read_measured(written(tmp_path, header, rows))
    assert cause in refused.value.cause
    assert refused.value.cure
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"# nothing\n", b"\x89PNG\x00\xff", b"PK\x03\x04"])
def test_files_of_another_kind_are_refused(tmp_path, content):
    file = tmp_path / "other.csv"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match="measurements"):
        read_measured(file)
