"""What the generator writes is current, deterministic and complete."""

import copy
import subprocess
import sys
from types import ModuleType
from typing import Any

import pytest

import generate
from ccr_protocol import cpp, python
from ccr_protocol.load import from_tree, load

from .conftest import PROTOCOL, ROOT
from .edit import field, find, value
from .odd_spec import make_odd

Tree = dict[str, Any]


@pytest.fixture
def written(tmp_path):
    """A root into which everything has been generated."""
    assert generate.main(["--root", str(tmp_path)]) == 0
    return tmp_path


@pytest.mark.long
def test_the_committed_files_are_current() -> None:
    files = generate.derived_files(load(PROTOCOL / "spec.toml"))
    assert generate.stale_files(files, ROOT) == []


@pytest.mark.long
def test_two_runs_give_the_same_bytes(tree: Tree) -> None:
    first = generate.derived_files(from_tree(copy.deepcopy(tree)))
    assert generate.derived_files(from_tree(tree)) == first


@pytest.mark.long
def test_check_passes_on_what_was_just_written(written, capsys) -> None:
    assert generate.main(["--check", "--root", str(written)]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.long
def test_check_names_each_stale_file_and_writes_nothing(written, capsys) -> None:
    edited = written / "protocol/reference.md"
    edited.write_text("by hand")
    (written / "protocol/vectors.json").unlink()
    assert generate.main(["--check", "--root", str(written)]) == 1
    assert capsys.readouterr().err.splitlines() == [
        "protocol/reference.md is stale: run protocol/generate.py",
        "protocol/vectors.json is stale: run protocol/generate.py",
    ]
    assert edited.read_text() == "by hand"


def test_a_bad_spec_gets_its_problems_and_status_2(tmp_path, capsys) -> None:
    text = (PROTOCOL / "spec.toml").read_text(encoding="utf-8")
    bad = tmp_path / "spec.toml"
    bad.write_text(text.replace('crc = "CRC-16/X-25"', 'crc = "CRC-8"'), encoding="utf-8")
    assert generate.main(["--spec", str(bad), "--root", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("framing, crc: must be 'CRC-16/X-25', not 'CRC-8'")
    assert list(tmp_path.iterdir()) == [bad]


def test_every_message_enum_and_requirement_is_in_the_reference(tree: Tree) -> None:
    reference = (PROTOCOL / "reference.md").read_text(encoding="utf-8")
    for kind in ("enum", "flags", "struct", "message"):
        for node in tree[kind]:
            assert f"### `{node['name']}`" in reference
    for requirement in tree["requirement"]:
        assert f"| {requirement['id']} | " in reference


def test_no_placeholder_is_left_in_the_reference() -> None:
    assert "{{" not in (PROTOCOL / "reference.md").read_text(encoding="utf-8")


MEANINGFUL = {
    "unit": lambda t: field(t, "message", "set_target", "ramp_ms").update(unit="s"),
    "scale": lambda t: field(t, "message", "set_target", "ramp_ms").update(scale=2),
    "range": lambda t: field(t, "message", "set_target", "ramp_ms").update(max=9999),
    "enumerator": lambda t: value(t, "fault", "internal").update(value=200),
    "constant": lambda t: find(t, "constant", "boot_ticks").update(value=6),
    "retry": lambda t: find(t, "message", "arm").update(retry="repeat"),
    "consistency": lambda t: find(t, "struct", "limits").pop("consistent"),
    "transition": lambda t: t["state_machine"]["transitions"][0].update(to="stopped"),
    "field order": lambda t: find(t, "message", "nack")["fields"].reverse(),
    "EEPROM": lambda t: t["eeprom"].update(magic=1),
    "framing": lambda t: t["framing"].update(max_payload=47),
    "optional message made mandatory": lambda t: [
        find(t, "message", name).pop("optional")
        for name in ("get_link_limits", "link_limits_reply")
    ],
}

MEANINGLESS = {
    "prose": lambda t: find(t, "message", "arm").update(prose="Arms."),
    "wording of a requirement": lambda t: t["requirement"][0].update(text="Frames."),
    "firmware version": lambda t: t["protocol"].update(firmware_version=[9, 9, 9]),
    "order of messages": lambda t: t["message"].reverse(),
    "order of transitions": lambda t: t["state_machine"]["transitions"].reverse(),
    "optional message and its capability": lambda t: (
        find(t, "flags", "capabilities")["bits"].append(
            {"name": "telepathy", "bit": 15, "prose": "New."}
        ),
        t["message"].append(
            {**find(t, "message", "telemetry"), "id": 0xD5, "name": "mood", "optional": "telepathy"}
        ),
    ),
}


@pytest.mark.parametrize("edit", MEANINGFUL.values(), ids=MEANINGFUL.keys())
def test_the_spec_hash_tells_what_the_wire_or_the_board_would_notice(tree: Tree, edit) -> None:
    before = from_tree(copy.deepcopy(tree)).hash
    edit(tree)
    assert from_tree(tree).hash != before


@pytest.mark.parametrize("edit", MEANINGLESS.values(), ids=MEANINGLESS.keys())
def test_the_spec_hash_leaves_out_the_rest(tree: Tree, edit) -> None:
    before = from_tree(copy.deepcopy(tree)).hash
    edit(tree)
    assert from_tree(tree).hash == before


@pytest.fixture
def odd_messages(tree: Tree, monkeypatch) -> ModuleType:
    """The Python module of a spec with shapes that the real one does not have."""
    make_odd(tree)
    module = ModuleType("odd_messages")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(python.generate(from_tree(tree)), module.__dict__)
    return module


def test_odd_shapes_make_python_that_packs_and_unpacks(odd_messages) -> None:
    integers = odd_messages.Integers(-128, 255, 32767, -(2**31), 2**32 - 1)
    assert odd_messages.Integers.unpack(integers.pack()) == integers
    assert integers.first_out_of_range() == 3
    nesting = odd_messages.Nesting(
        own=(-1, 0, 1),
        many=(1, 2, 3, 4, 5, 65535),
        unranged=odd_messages.Unranged(odd_messages.Sparse.VALUE_700, odd_messages.ConfigGroups(3)),
    )
    assert odd_messages.Nesting.unpack(nesting.pack()) == nesting
    assert nesting.first_out_of_range() is None
    assert odd_messages.BOOT_TICKS == -70000
    with pytest.raises(odd_messages.PayloadError, match="is no Sparse"):
        odd_messages.Nesting.unpack(bytes(odd_messages.Nesting.SIZE))


def test_python_of_odd_shapes_is_already_formatted(tree: Tree) -> None:
    make_odd(tree)
    text = python.generate(from_tree(tree))
    formatter = [sys.executable, "-m", "ruff", "format", "--config", str(ROOT / "pyproject.toml")]
    formatted = subprocess.run(
        [*formatter, "-"], input=text, capture_output=True, text=True, check=True
    )
    assert formatted.stdout == text


def test_odd_shapes_make_cpp_that_compiles_without_a_warning(tree: Tree, tmp_path) -> None:
    make_odd(tree)
    (tmp_path / "ccr_messages.h").write_text(cpp.generate(from_tree(tree)), encoding="utf-8")
    source = tmp_path / "odd.cpp"
    source.write_text(
        '#include "ccr_messages.h"\n'
        'static_assert(ccr::is_sparse(700) && !ccr::is_sparse(4), "gaps");\n'
        'static_assert(ccr::kBootTicks == -70000L, "negative");\n'
    )
    library = ROOT / "firmware" / "lib" / "protocol"
    strict = ["-std=c++14", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wsign-conversion"]
    result = subprocess.run(
        ["g++", *strict, f"-I{tmp_path}", f"-I{library}", "-fsyntax-only", str(source)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
