import datetime
import tomllib

import pytest

from ccr_host.errors import ConfigError
from ccr_host.run.registration_file import save_registration, with_registration

SECTION = {
    "camera_to_robot_deg": [1.5, -170.25, 0.0],
    "uncertainty_deg": [0.3, 0.1, 0.1],
    "residual_mm": 0.08,
    "scale": 1.001,
    "date": datetime.date(2025, 3, 1),
}
OLD = "[registration]\ncamera_to_robot_deg = [9.0, 9.0, 9.0]  # by hand\nresidual_mm = 3.0\n"

TEXTS = {
    "empty": "",
    "no section": '# my robot\nname = "x"\n\n[twin]\nslack_mm = 0.8  # measured\n',
    "no newline at the end": "[twin]\nslack_mm = 0.8",
    "last section": f"# top\n[twin]\nslack_mm = 0.8\n\n{OLD}",
    "first section": f"{OLD}\n# about the twin\n[twin]\nslack_mm = 0.8\n",
    "between": f"[robot]\n\n{OLD}\n# about the twin\n\n[twin] # here\nslack_mm = 0.8\n",
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_only_the_section_changes(text):
    edited = with_registration(text, SECTION)
    tree = tomllib.loads(edited)
    assert tree.pop("registration") == SECTION
    before = tomllib.loads(text)
    before.pop("registration", None)
    assert tree == before
    kept = [line for line in text.replace(OLD, "").splitlines() if line.strip()]
    assert [line for line in edited.splitlines() if line in kept] == kept


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_registering_twice_changes_nothing_more(text):
    once = with_registration(text, SECTION)
    assert with_registration(once, SECTION) == once


@pytest.mark.parametrize(
    "text",
    [
        "registration = {residual_mm = 1.0}\n",
        "registration.residual_mm = 1.0\n",
        'name = """\n[registration]\n"""\n',
        "[registration]\nresidual_mm = 1.0\n[registration.more]\nkey = 1\n",
    ],
)
def test_what_cannot_be_edited_safely_is_refused(text):
    with pytest.raises(ConfigError, match="cannot be replaced"):
        with_registration(text, SECTION)


def test_the_file_is_replaced_through_links_and_keeps_its_mode(tmp_path):
    file, link = tmp_path / "robot.toml", tmp_path / "link.toml"
    file.write_text("# mine\n", encoding="utf-8")
    file.chmod(0o640)
    link.symlink_to(file)
    save_registration(link, SECTION)
    assert link.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o640
    assert file.read_text(encoding="utf-8").startswith("# mine\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.toml", "robot.toml"]


def test_a_refused_edit_leaves_the_file_as_it_was(tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text("registration = {}\n", encoding="utf-8")
    with pytest.raises(ConfigError):
        save_registration(file, SECTION)
    assert file.read_text(encoding="utf-8") == "registration = {}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["robot.toml"]


@pytest.mark.parametrize("content", [None, b"[twin\n", b"\xff\xfe"])
def test_an_unreadable_description_is_told(tmp_path, content):
    file = tmp_path / "robot.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=r"robot description .*robot\.toml"):
        save_registration(file, SECTION)
