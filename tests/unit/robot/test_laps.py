import numpy as np
import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path, path_names
from ccr_host.robot.workspace import MotorLimits, Workspace

DESCRIPTION = Description()


def _path(name, rate_hz=1.0):
    limits = MotorLimits.of(DESCRIPTION.servo)
    return load_path(str(name), rate_hz, Workspace(ConstantCurvature(DESCRIPTION.robot), limits))


def _file(folder, rows):
    file = folder / "path.csv"
    file.write_text("t_s,y_mm,z_mm\n" + "".join(f"{t},{y},{z}\n" for t, y, z in rows))
    return file


@pytest.mark.parametrize("rate_hz", [0.5, 1.0, 20.0])
@pytest.mark.parametrize("name", path_names())
def test_the_papers_paths_go_on_from_lap_to_lap_on_one_clock(name, rate_hz):
    lap = _path(name, rate_hz)
    laps = lap.repeated(3)
    assert len(laps) == 3 * len(lap) == 3 * laps.lap_steps
    assert np.diff(laps.time_s) == pytest.approx(1.0 / rate_hz)
    for number in range(3):
        steps = slice(number * len(lap), (number + 1) * len(lap))
        assert np.array_equal(laps.target_mm[steps], lap.target_mm)


def test_one_lap_is_the_path_itself():
    lap = _path("star")
    assert lap.repeated(1) is lap
    assert lap.lap_steps == len(lap)


def test_the_point_that_closes_a_file_is_not_visited_twice(tmp_path):
    square = [(0, 0, 50), (5, 10, 50), (10, 10, 40), (15, 0, 40), (20, 0, 50)]
    lap = _path(_file(tmp_path, square))
    laps = lap.repeated(2)
    assert laps.lap_steps == len(lap) - 1 == 20
    seam_mm = np.linalg.norm(np.diff(laps.target_mm[:, [0, 2]], axis=0), axis=1)
    assert seam_mm == pytest.approx(2.0)


def test_an_open_path_has_no_laps(tmp_path):
    lap = _path(_file(tmp_path, [(0, 0, 40), (20, 20, 40)]))
    with pytest.raises(ConfigError, match=r"ends 2\d\.\d mm from its start"):
        lap.repeated(2)


def test_laps_without_end_are_refused():
    with pytest.raises(ConfigError, match="samples"):
        _path("star", 20.0).repeated(1000)
