import datetime
import tomllib

import pytest

from ccr_host import config
from ccr_host.description_file import update_description, updated
from ccr_host.errors import ConfigError
from ccr_host.run.registration_file import save_registration

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
    save_registration(file, REGISTRATION)
    registration = config.load(str(file)).registration
    assert registration is not None
    assert registration.camera_to_robot_deg == (1.5, -170.25, 0.0)
    assert registration.date == "2025-03-01"


def test_the_file_is_replaced_through_links_and_keeps_its_mode(tmp_path) -> None:
    file, link = tmp_path / "robot.toml", tmp_path / "link.toml"
    file.write_text("# mine\n", encoding="utf-8")
    file.chmod(0o640)
    link.symlink_to(file)
    update_description(link, NEW)
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
        update_description(file, sections)
    assert file.read_text(encoding="utf-8") == 'name = "mine"\n'
    assert [path.name for path in tmp_path.iterdir()] == ["robot.toml"]


@pytest.mark.parametrize("content", [None, b"[twin\n", b"\xff\xfe"])
def test_an_unreadable_description_is_told(tmp_path, content) -> None:
    file = tmp_path / "robot.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=r"robot description"):
        update_description(file, NEW)
