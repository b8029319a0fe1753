import datetime
import os
import tempfile
import tomllib

import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.description.file import file_to_keep_in, keep_in, updated
from ccr_host.description.source import text_and_encoding_of

REGISTRATION = {
    "camera_to_robot_deg": [1.5, -170.25, 0.0],
    "uncertainty_deg": [0.3, 0.1, 0.1],
    "residual_mm": 0.08,
    "scale": 1.001,
    "date": datetime.date(2025, 3, 1),
}
NEW = {"registration": REGISTRATION, "servo": {"neutral_pulse_us": [1520.5, 1490.0]}}
OLD = "[registration]\ncamera_to_robot_deg = [9.0, 9.0, 9.0]  # by hand\nresidual_mm = 3.0\n"

TEXTS = {
    "empty": "",
    "no such section": '# my robot\nname = "x"\n\n[twin]\nslack_mm = 0.8  # measured\n',
    "no newline at the end": "[twin]\nslack_mm = 0.8",
    "last section": f"# top\n[twin]\nslack_mm = 0.8\n\n{OLD}",
    "first section": f"{OLD}\n# about the twin\n[twin]\nslack_mm = 0.8\n",
    "other keys": "[servo]\nneutral_pulse_us = 1500\nslew_deg_s = 200  # gentle\n",
    "inline": "registration = {camera_to_robot_deg = [0, 0, 0], residual_mm = 1.0}\n",
    "dotted": "registration.residual_mm = 1.0\nservo.slew_deg_s = 200 # gentle\n",
    "a header inside a string": 'name = """\n[registration]\n"""\n',
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_only_the_given_keys_change(text: str) -> None:
    expected = tomllib.loads(text)
    for section, values in NEW.items():
        expected[section] = expected.get(section, {}) | values
    assert tomllib.loads(updated(text, NEW)) == expected


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_comments_stay(text: str) -> None:
    comments = [part.split("\n")[0] for part in text.split("#")[1:] if "by hand" not in part]
    edited = updated(text, NEW)
    assert all(f"#{comment}" in edited for comment in comments)


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_the_same_update_twice_changes_nothing_more(text: str) -> None:
    once = updated(text, NEW)
    assert updated(once, NEW) == once


def test_a_registration_can_be_read_back(tmp_path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text("# mine\n")
    keep_in(file, NEW, None)
    registration = schema.load(str(file)).registration
    assert registration is not None
    assert registration.camera_to_robot_deg == (1.5, -170.25, 0.0)
    assert registration.date == "2025-03-01"


@pytest.mark.long
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_encoding_byte_order_mark_and_line_ends_stay(tmp_path, text, end, encoding) -> None:
    file = tmp_path / "robot.toml"
    file.write_bytes(text.replace("\n", end).encode(encoding))
    keep_in(file, NEW, None)
    new = file.read_bytes().decode(encoding)
    assert "\ufeff" not in new
    assert end == "\n" or "\n" not in text or "\n" not in new.replace("\r\n", "")
    assert tomllib.loads(new) == tomllib.loads(updated(text, NEW))
    assert schema.load(str(file)).registration is not None


def test_the_file_is_replaced_through_links_and_keeps_its_mode(tmp_path) -> None:
    file, link = tmp_path / "robot.toml", tmp_path / "link.toml"
    file.write_text("# mine\n", encoding="utf-8")
    file.chmod(0o640)
    link.symlink_to(file)
    keep_in(link, NEW, None)
    assert link.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o640
    assert file.read_text(encoding="utf-8").startswith("# mine\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.toml", "robot.toml"]


@pytest.mark.parametrize(
    ("sections", "told"),
    [({"servo": {"neutral_pulse_us": -3}}, "neutral_pulse_us"), ({"name": {"x": 1}}, "robot desc")],
)
def test_what_would_be_no_description_is_refused_and_the_file_left_alone(
    tmp_path, sections, told
) -> None:
    file = tmp_path / "robot.toml"
    file.write_text('name = "mine"\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=told):
        keep_in(file, sections, None)
    assert file.read_text(encoding="utf-8") == 'name = "mine"\n'
    assert [path.name for path in tmp_path.iterdir()] == ["robot.toml"]


@pytest.mark.parametrize("content", [b"[twin\n", b"\xff\xfe\x00", b"[" * 50_000])
def test_an_unreadable_description_is_reported_and_left_unchanged(tmp_path, content) -> None:
    file = tmp_path / "robot.toml"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=r"robot description"):
        keep_in(file, NEW, None)
    assert file.read_bytes() == content


@pytest.mark.parametrize("robot", [None, "hard"])
def test_a_file_that_is_not_there_is_made_from_the_described_robot(tmp_path, robot) -> None:
    file = tmp_path / "robot.toml"
    keep_in(file, NEW, robot)
    text, encoding = text_and_encoding_of(robot)
    assert file.read_text(encoding).startswith(text.rstrip())
    old, new = schema.load(robot), schema.load(str(file))
    assert new.servo.neutral_pulse_us == (1520.5, 1490.0)
    assert new.twin.friction == old.twin.friction


def test_a_file_that_is_not_there_stays_so_if_it_would_be_no_description(tmp_path) -> None:
    with pytest.raises(ConfigError, match="neutral_pulse_us"):
        keep_in(tmp_path / "robot.toml", {"servo": {"neutral_pulse_us": -3}}, None)
    assert not list(tmp_path.iterdir())


def test_what_is_measured_goes_where_out_says_else_into_the_users_own_file(tmp_path) -> None:
    own, other = tmp_path / "own.toml", tmp_path / "other.toml"
    assert file_to_keep_in(str(own), other) == other
    assert file_to_keep_in(str(own), None) == own
    assert file_to_keep_in("hard", other) == other
    assert file_to_keep_in("hard", None) is None
    assert file_to_keep_in(None, None) is None


HAS_PIPES = hasattr(os, "mkfifo")


@pytest.mark.parametrize(
    "out",
    [
        "",
        "no/such/folder/robot.toml",
        "x" * 300,
        "a\0b",
        "loop",
        "robot.toml/x",
        *(["pipe"] if HAS_PIPES else []),
    ],
)
def test_an_unwritable_place_is_reported_beforehand(tmp_path, out) -> None:
    if HAS_PIPES:
        os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop/x")
    (tmp_path / "robot.toml").write_text("")
    with pytest.raises(ConfigError, match="cannot be written"):
        file_to_keep_in(None, tmp_path / out)


def test_what_was_measured_outlives_the_folder_of_the_description(tmp_path) -> None:
    file = tmp_path / "gone" / "mine.toml"
    keep_in(file, {"robot": {"pulley_radius_mm": 11.0}}, None)
    assert schema.load(str(file)).robot.pulley_radius_mm == 11.0


@pytest.mark.parametrize("content", [None, b"[robot", b"\xff\xfe\xff"])
def test_what_cannot_be_kept_in_the_description_is_kept_elsewhere(
    tmp_path, monkeypatch, content
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    file = tmp_path / "mine.toml"
    if content is None:
        file.mkdir()
    else:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=r"mine\.toml.*copy it into a description"):
        keep_in(file, {"robot": {"pulley_radius_mm": 11.0}}, None)
    (kept,) = tmp_path.glob("ccr-host-*.toml")
    assert schema.load(str(kept)).robot.pulley_radius_mm == 11.0
