"""A self-contained page about runs."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.system.conftest import AT_ONCE, PAPERS, CcrHost, write_short_path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run."""
    folder = tmp_path_factory.mktemp("recorded") / "kept"
    path = write_short_path(folder.parent)
    words = ("track", path, *PAPERS, *AT_ONCE, "--no-open", "--out", folder.name)
    assert CcrHost(folder.parent)(*words).status == 0
    return folder


@pytest.fixture
def with_run(ccr_host: CcrHost, recorded: Path) -> CcrHost:
    """A program whose run is in the folder "kept"."""
    shutil.copytree(recorded, ccr_host.folder / "kept")
    return ccr_host


def page_of(ccr_host: CcrHost, *words: str) -> str:
    ended = ccr_host("report", *words, drawn=True)
    assert ended.status == 0, ended.err
    return Path(ccr_host.folder, ended.out.split()[-1]).read_text()


def test_a_report_holds_figures_table_and_configuration_and_refers_to_nothing_outside(
    with_run: CcrHost,
) -> None:
    page = page_of(with_run, "kept")
    assert page.count("<svg") == 2
    assert "short, mpc, 1 Hz" in page
    assert "following the path" in page
    assert "tendon_radius_mm" in page
    references = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert all(reference.startswith("#") for reference in references)


def test_runs_on_one_path_are_laid_over_each_other(with_run: CcrHost, short_path: str) -> None:
    common = (*PAPERS, *AT_ONCE, "--no-open", "--out")
    other = with_run.folder / "other.csv"
    other.write_text("t_s,y_mm,z_mm\n0,0,30\n3,6,33\n")
    assert with_run("track", short_path, *common, "b", "--seed", "2").status == 0
    assert with_run("track", str(other), *common, "c").status == 0
    page = page_of(with_run, "kept", "b", "c")
    assert page.count("<svg") == 1 + 2 * 3
    assert page.count("short, mpc, 1 Hz, kept</a>") == 1, "equal titles are told apart"
    assert page.count("other, mpc, 1 Hz</a>") == 1


def test_a_report_says_why_measured_and_true_error_differ(
    ccr_host: CcrHost, short_path: str
) -> None:
    turned = ("--set", "tracker.rotation_deg=3", "--no-open", "--out", "kept")
    assert ccr_host("track", short_path, *PAPERS, *AT_ONCE, *turned).status == 0
    assert "turned by 3 deg" in page_of(ccr_host, "kept")


def test_a_run_that_was_killed_is_reported_as_far_as_its_log_goes(with_run: CcrHost) -> None:
    kept = with_run.folder / "kept"
    (kept / "run.json").unlink()
    log = kept / "log_0000.mcap"
    log.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    page = page_of(with_run, "kept")
    assert "never closed its log" in page
    assert page.count("<svg") == 2


def test_the_reason_of_an_early_end_is_reported(ccr_host: CcrHost) -> None:
    lost = ("--set", "tracker.dropout=0.99", "--set", "control.coast_s=0.1")
    ended = ccr_host("track", "8shape", *PAPERS, *lost, "--no-open", "--out", "kept")
    assert ended.status == 3
    assert 'class="fault">no markers' in page_of(ccr_host, "kept")


@pytest.mark.parametrize("words", [("nowhere",), ("kept", "--out", "no/such/folder.html")])
def test_what_cannot_be_reported_is_one_line(with_run: CcrHost, words: tuple[str, ...]) -> None:
    ended = with_run("report", *words)
    assert ended.status == 2
    assert ended.err.count("\n") == 1
