import pytest

from tests.system.conftest import PAPERS, CcrHost, Ended


def assert_one_clear_line(ended: Ended, status: int, *words: str) -> None:
    assert ended.status == status, ended.err
    assert ended.out == ""
    lines = ended.err.strip().splitlines()
    assert len(lines) == 1, ended.err
    assert "Traceback" not in ended.err
    for word in words:
        assert word in lines[0]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["track", "spiral"], ["spiral", "ellipse", "8shape", "star"]),
        (["track", "8shape", "--controller", "pid9"], ["pid9", "mpc"]),
        (["track", "8shape", "--robot", "nowhere.toml"], ["nowhere.toml"]),
        (["track", "8shape", "--set", "twin.slak_mm=1"], ["twin.slak_mm", "slack_mm"]),
        (["track", "8shape", "--set", "twin.slack_mm=-1"], ["twin.slack_mm"]),
        (["track", "8shape", "--set", "twin.slack_mm"], ["KEY=VALUE"]),
        (["track", "8shape", "--set", "twin.slack_mm=nan"], ["twin.slack_mm"]),
        (["track", "8shape", "--device", "usb:1"], ["usb:1", "serial:PORT"]),
        (["track", "8shape", "--device", "tcp://localhost"], ["tcp://"]),
        (["track", "8shape", "--tracker", "sonar:"], ["sonar:", "twin:"]),
        (["track", "8shape", "--rate", "0"], ["rate"]),
        (["track", "8shape", "--rate", "-1"], ["rate"]),
        (["track", "8shape", "--rate", "nan"], ["rate"]),
        (["track", "8shape", "--rate", "1e9"], ["rate"]),
        (["track", "8shape", "--seed", "-1"], ["seed"]),
        (["track", "8shape", "--out", "/proc/nowhere"], ["/proc/nowhere"]),
        (["track", "8shape", "--out", "/dev/null"], ["/dev/null: not a folder"]),
        (["compare", "--controller", "pid9"], ["pid9"]),
        (["compare", "--path", "spiral"], ["spiral"]),
        (["workspace", "spiral"], ["spiral"]),
        (["emulate", "--tcp", "5025"], ["5025", "host and a port"]),
        (["emulate", "--tcp", "127.0.0.1:99999"], ["99999"]),
    ],
)
def test_a_word_that_makes_no_sense_gets_one_line_with_the_cure(
    ccr_host: CcrHost, words: list[str], named: list[str]
) -> None:
    assert_one_clear_line(ccr_host(*words), 2, *named)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("t_s,y_mm\n0,1\n1,2\n", ["z_mm"]),
        ("t_s,y_mm,z_mm\n0,0,30\n1,nan,31\n", ["3", "y_mm"]),
        ("t_s,y_mm,z_mm\n0,0,30\n0,1,31\n", ["3", "time"]),
        ("t_s,y_mm,z_mm\n0,0,30\n", ["1 row"]),
        ("t_s,y_mm,z_mm\n0,0,thirty\n1,0,30\n", ["thirty"]),
        ("t_s,y_mm,z_mm\n0,0\n1,0,30\n", ["2"]),
        ("", ["empty"]),
        ("\x00\x01\x02\n", []),
    ],
)
def test_a_bad_path_file_gets_one_line_that_names_file_and_place(
    ccr_host: CcrHost, text: str, named: list[str]
) -> None:
    (ccr_host.folder / "bad.csv").write_text(text)
    assert_one_clear_line(ccr_host("track", "bad.csv"), 2, "bad.csv", *named)


def test_a_path_file_that_is_not_there(ccr_host: CcrHost) -> None:
    assert_one_clear_line(ccr_host("track", "gone.csv"), 2, "gone.csv")


def test_a_broken_robot_description(ccr_host: CcrHost) -> None:
    (ccr_host.folder / "robot.toml").write_text("[twin\n")
    assert_one_clear_line(
        ccr_host("track", "8shape", *PAPERS, "--robot", "robot.toml"), 2, "robot.toml"
    )


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--device", "serial:/dev/nowhere"], ["/dev/nowhere"]),
        (["--device", "tcp://127.0.0.1:1"], ["127.0.0.1:1", "refused"]),
    ],
)
def test_a_board_that_is_not_there_is_a_device_fault(
    ccr_host: CcrHost, words: list[str], named: list[str]
) -> None:
    ended = ccr_host("track", "8shape", *PAPERS, *words, "--json")
    assert ended.status == 3
    last = ended.err.strip().splitlines()[-1]
    for word in named:
        assert word in last
    assert "Traceback" not in ended.err


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["track", "8shape", "--fast"], ["--fast"]),
        (["track"], ["PATH"]),
        (["trak"], ["trak"]),
        (["track", "8shape", "--rate", "quick"], ["--rate"]),
    ],
)
def test_usage_errors_get_one_line_too(
    ccr_host: CcrHost, words: list[str], named: list[str]
) -> None:
    assert_one_clear_line(ccr_host(*words), 2, *named, "--help")
