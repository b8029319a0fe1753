"""Words that are no command line are answered in our words, with the help that says more."""

import pytest

from ccr_host.commands.app import run
from ccr_host.core.errors import ConfigError


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
