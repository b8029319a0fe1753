import math
import shutil

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.tools.sweep.job import run_job
from ccr_host.tools.sweep.plan import GivenTwin, SweepPlan
from ccr_host.tools.sweep.store import SweepFolder

DRIVES = [(2.0, "open-loop"), (4.0, "open-loop")]


@pytest.mark.long
def test_every_figure_of_a_run_has_its_column_and_comes_back_as_it_was(tmp_path, plan):
    store = SweepFolder(tmp_path, plan)
    (job,) = plan.jobs([1], DRIVES)
    rows = run_job(job)
    store.keep(rows)
    assert store.rows() == rows
    assert list(rows[0]) != []
    store.gather()
    table = pq.read_table(tmp_path / "runs.parquet")
    assert set(table.column_names) == set(rows[0])
    assert not list((tmp_path / "parts").iterdir())


def test_a_sweep_continues_where_it_was_left(tmp_path, plan, row):
    jobs = plan.jobs(range(3), [(1.0, "mpc"), (1.0, "adaptive")])
    SweepFolder(tmp_path, plan).keep([row(0), row(0, controller="adaptive")])
    SweepFolder(tmp_path, plan).gather()
    SweepFolder(tmp_path, plan).keep([row(2)])
    left = SweepFolder(tmp_path, plan).missing(jobs)
    assert [(job.index, job.drives) for job in left] == [
        (1, ((1.0, "mpc"), (1.0, "adaptive"))),
        (2, ((1.0, "adaptive"),)),
    ]


def test_controllers_in_files_and_many_of_them_have_rows_too(tmp_path, plan, row):
    names = [f"controllers/of/mine{number}.py:Mine" for number in range(20)]
    SweepFolder(tmp_path, plan).keep([row(0, controller=name) for name in names])
    SweepFolder(tmp_path, plan).keep([row(0, controller="mpc")])
    found = {r["controller"] for r in SweepFolder(tmp_path, plan).rows()}
    assert found == {*names, "mpc"}


def test_a_part_cut_off_while_it_was_written_is_not_taken_for_a_row(tmp_path, plan, row):
    store = SweepFolder(tmp_path, plan)
    store.keep([row(0)])
    (part,) = (tmp_path / "parts").iterdir()
    part.with_suffix(".4711").write_bytes(part.read_bytes()[:100])
    assert [r["index"] for r in SweepFolder(tmp_path, plan).rows()] == [0]


def test_a_sweep_cut_off_while_it_wrote_its_plan_can_be_begun_again(
    tmp_path, plan, row, monkeypatch
):
    def cut_off(*_: object) -> None:
        raise OSError

    with monkeypatch.context() as patch:
        patch.setattr("ccr_host.tools.sweep.store.write_json", cut_off)
        with pytest.raises(OSError):
            SweepFolder(tmp_path, plan).keep([row(0)])
    SweepFolder(tmp_path, plan).keep([row(0)])
    assert [r["index"] for r in SweepFolder(tmp_path, plan).rows()] == [0]


def test_rows_are_ordered_whatever_the_order_they_came_in(tmp_path, plan, row):
    store = SweepFolder(tmp_path, plan)
    for index in (5, 0, 3):
        store.keep([row(index, rate_hz=20.0), row(index)])
    found = [(r["index"], r["rate_hz"]) for r in store.rows()]
    assert found == [(0, 1.0), (0, 20.0), (3, 1.0), (3, 20.0), (5, 1.0), (5, 20.0)]


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"seed": 8}, "seed"),
        ({"paths": ("8shape",)}, "paths"),
        ({"overrides": ("twin.friction=0.1",)}, "description"),
        ({"twins": (GivenTwin({"twin.slack_mm": 1.0}),)}, "twins"),
    ],
)
def test_a_folder_of_other_twins_is_refused_and_the_difference_named(
    tmp_path, plan, row, changed, named
):
    SweepFolder(tmp_path, plan).keep([row(0)])
    with pytest.raises(ConfigError, match=named):
        SweepFolder(tmp_path, SweepPlan(**{**vars(plan), **changed}))


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"plan": 3}', b"\xff", b"[" * 99_999])
def test_a_damaged_plan_is_refused(tmp_path, plan, content):
    (tmp_path / "sweep.json").write_bytes(content)
    with pytest.raises(ConfigError, match=r"sweep\.json"):
        SweepFolder(tmp_path, plan)


def test_a_damaged_part_is_named(tmp_path, plan, row):
    store = SweepFolder(tmp_path, plan)
    store.keep([row(0)])
    (part,) = (tmp_path / "parts").iterdir()
    part.write_bytes(b"PAR1 no more")
    with pytest.raises(ConfigError, match=part.name):
        SweepFolder(tmp_path, plan)


@pytest.mark.parametrize("damage", [b"\xff", b"!"])
def test_one_damaged_byte_of_a_row_is_noticed(tmp_path, plan, row, damage):
    store = SweepFolder(tmp_path, plan)
    store.keep([row(0, command="ccr-host track and so on")])
    (part,) = (tmp_path / "parts").iterdir()
    part.write_bytes(part.read_bytes().replace(b"track and", b"tr" + damage + b"ck and"))
    with pytest.raises(ConfigError, match=part.name):
        SweepFolder(tmp_path, plan)


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table.drop_columns(["seed"]),
        lambda table: table.set_column(0, "index", pa.array(["a"])),
        lambda table: table.set_column(0, "index", pa.array([None], pa.int64())),
        lambda table: table.set_column(2, "rate_hz", pa.array([None], pa.float64())),
        lambda table: table.set_column(
            table.column_names.index("true_mean_error_mm"),
            "true_mean_error_mm",
            pa.array([None], pa.float64()),
        ),
        lambda table: table.set_column(2, "rate_hz", pa.array([-1.0])),
        lambda table: table.set_column(2, "rate_hz", pa.array([math.nan])),
        lambda table: table.set_column(
            table.column_names.index("ratio"), "ratio", pa.array([math.inf])
        ),
        lambda _: pa.table({"index": pa.nulls(2_000_000, pa.int64())}),
    ],
)
def test_a_part_of_other_columns_or_with_gaps_is_named(tmp_path, plan, row, change):
    store = SweepFolder(tmp_path, plan)
    store.keep([row(0)])
    (part,) = (tmp_path / "parts").iterdir()
    pq.write_table(change(pq.read_table(part)), part)
    with pytest.raises(ConfigError, match=part.name):
        SweepFolder(tmp_path, plan).rows()


def test_a_row_that_could_not_be_stored_is_missing(tmp_path, plan, row):
    store = SweepFolder(tmp_path, plan)
    store.keep([row(0)])
    (part,) = (tmp_path / "parts").iterdir()
    taken = part.with_name(part.name.replace("000000", "000001"))
    taken.mkdir()
    with pytest.raises(OSError):
        store.keep([row(1)])
    taken.rmdir()
    jobs = plan.jobs(range(2), [(1.0, "mpc")])
    for again in (store, SweepFolder(tmp_path, plan)):
        assert [job.index for job in again.missing(jobs)] == [1]


def test_rows_survive_the_removal_of_their_folder(tmp_path, plan, row):
    folder = tmp_path / "sweep"
    store = SweepFolder(folder, plan)
    store.keep([row(0)])
    shutil.rmtree(folder)
    store.keep([row(1)])
    store.gather()
    assert [r["index"] for r in SweepFolder(folder, plan).rows()] == [0, 1]


def test_rows_without_the_plan_they_belong_to_are_refused(tmp_path, plan, row):
    store = SweepFolder(tmp_path, plan)
    store.keep([row(0)])
    store.gather()
    (tmp_path / "sweep.json").unlink()
    with pytest.raises(ConfigError, match=r"sweep\.json"):
        SweepFolder(tmp_path, plan)
