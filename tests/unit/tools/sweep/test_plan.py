import shlex
from itertools import pairwise

import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.tools.sweep.plan import SweepPlan, read_twins

ONE_HZ = [(1.0, "mpc")]


def test_a_twin_follows_from_seed_and_index_alone(plan):
    alone = plan.jobs([4], [(2.0, "open-loop")])[0]
    among_others = plan.jobs(range(6), ONE_HZ)[4]
    assert alone.base == among_others.base


def test_twins_differ_and_so_do_those_of_other_seeds(plan, short_path, narrow):
    other = SweepPlan(seed=4, paths=(short_path,), overrides=narrow)
    twins = [job.base.overrides for p in (plan, other) for job in p.jobs(range(5), ONE_HZ)]
    assert len(set(twins)) == 10


def test_paths_take_turns():
    jobs = SweepPlan(seed=1, paths=("ellipse", "star")).jobs(range(4), ONE_HZ)
    assert [job.base.path for job in jobs] == ["ellipse", "star", "ellipse", "star"]


def test_the_command_line_of_a_run_carries_all_that_decides_it(plan):
    job = plan.jobs([2], [(2.5, "open-loop")])[0]
    words = shlex.split(job.command((2.5, "open-loop")))
    sets = tuple(after for before, after in pairwise(words) if before == "--set")
    options = job.options((2.5, "open-loop"))
    assert sets == options.overrides
    assert words[:3] == ["ccr-host", "track", options.path]
    assert words[words.index("--seed") + 1] == str(options.seed)
    assert float(words[words.index("--rate") + 1]) == options.rate_hz
    assert words[words.index("--controller") + 1] == options.controller


def test_twins_of_ones_own_are_taken_in_order(short_path, tmp_path):
    file = tmp_path / "twins.jsonl"
    file.write_text('{"twin.slack_mm": 0.5}\n\n{"tracker.rotation_deg": [1, 0, 2.5]}\n')
    jobs = SweepPlan(1, (short_path,), twins=read_twins(file)).jobs([0, 1], ONE_HZ)
    first, second = (job.options(ONE_HZ[0]).description() for job in jobs)
    assert first.twin.slack_mm == (0.5,) * 4
    assert second.tracker.rotation_deg == (1.0, 0.0, 2.5)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ("", "empty"),
        ("[1]\n", "line 1"),
        ('{"a": 1}\n{"twin.slack', "line 2"),
        (
            '{}\n{"twin.slack_mm": 1, "twin.slack_mm": 2}',
            "line 2: twin.slack_mm stands there twice",
        ),
        ('{"twin.push": {"start_s": 1, "start_s": 2}}', "line 1: start_s stands there twice"),
    ],
)
def test_an_unusable_file_of_twins_is_named_with_its_line(tmp_path, content, named):
    file = tmp_path / "twins.jsonl"
    file.write_text(content)
    with pytest.raises(ConfigError, match=named):
        read_twins(file)


@pytest.mark.parametrize(
    "setting", ['{"twin.slak_mm": 1}', '{"twin.slack_mm": -1}', '{"twin.slack_mm": "much"}']
)
def test_a_twin_that_makes_no_robot_is_refused_before_anything_runs(short_path, tmp_path, setting):
    file = tmp_path / "twins.jsonl"
    file.write_text("\n{}\n" + setting)
    with pytest.raises(ConfigError, match=r"twins\.jsonl, line 3: .*twin\.sla"):
        SweepPlan(1, (short_path,), twins=read_twins(file)).jobs([0, 1], ONE_HZ)
