"""Words that are no command line are answered in our words, with the help that says more."""

import inspect
from typing import Annotated

import pytest

from ccr_host.commands.app import run
from ccr_host.commands.options import Without, with_rig_options
from ccr_host.core.errors import ConfigError
from ccr_host.run.options import RigOptions


@pytest.mark.parametrize(
    ("words", "cause", "cure"),
    [
        (["sweep", "--no-open"], "No such option: --no-open", "see ccr-host sweep --help"),
        (["sweep", "--workers", "0"], "'--workers': less than 1", "see ccr-host sweep --help"),
        (["sweep", "--workers", "5000"], "more than 1024", "see ccr-host sweep --help"),
        (["sweep", "--workers", "x"], "not a whole number", "see ccr-host sweep --help"),
        (["track", "star", "--rate", "fast"], "'--rate': not a number", "see ccr-host track"),
        (["track", "star", "--seed", "nan"], "'--seed': not a whole number", "see ccr-host track"),
        (["track", "star", "--surface", "mars"], "'mars' is not one of", "see ccr-host track"),
        (["identify"], "Missing argument 'FILE.csv'", "see ccr-host identify --help"),
        (["emulate", "--tcp"], "requires an argument", "see ccr-host emulate --help"),
        (["trakc"], "Did you mean 'track'?", "see ccr-host --help"),
        (["--tcp"], "No such option: --tcp", "see ccr-host --help"),
    ],
)
def test_a_usage_error_names_the_cause_and_the_help_of_its_command(
    words: list[str], cause: str, cure: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        run(words)
    assert cause in refused.value.cause
    assert refused.value.cure.startswith(cure)
    assert "Input should" not in refused.value.cause


def test_a_command_has_an_option_for_each_field_of_its_rig_but_those_it_leaves_out() -> None:
    taken: list[RigOptions] = []

    def command(rig: Annotated[RigOptions, Without("plant")], path: str = "star") -> None:
        taken.append(rig)

    spelled_out = with_rig_options(command)
    words = {"robot", "device", "tracker", "seed", "overrides", "realtime"}
    assert set(inspect.signature(spelled_out).parameters) == {*words, "path"}
    given = {name: value for name, value in vars(RigOptions(seed=7)).items() if name in words}
    spelled_out(**given | {"overrides": ["twin.slack_mm=1"]}, path="star")
    assert taken == [RigOptions(seed=7, overrides=("twin.slack_mm=1",))]
