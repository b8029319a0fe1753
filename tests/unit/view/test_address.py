import pytest

from ccr_host.commands.view import with_default_address
from ccr_host.core.errors import ConfigError
from ccr_host.view import DEFAULT_ADDRESS
from ccr_host.view.live import (
    ViewAddress,
    open_door,
    parse_view_address,
    require_viser,
)


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        (DEFAULT_ADDRESS, "127.0.0.1", 8642),
        ("localhost:0", "localhost", 0),
        ("[::1]:80", "::1", 80),
        ("lab.example:80", "lab.example", 80),
    ],
)
def test_an_address_is_a_host_and_a_port(text: str, host: str, port: int) -> None:
    assert parse_view_address(text) == ViewAddress(host, port)


@pytest.mark.parametrize("text", ["", "8642", ":8642", "host:", "host:x", "host:-1", "host:65536"])
def test_what_is_no_address_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ConfigError, match=DEFAULT_ADDRESS):
        parse_view_address(text)


def test_the_option_that_was_given_is_named() -> None:
    with pytest.raises(ConfigError, match=f"--address nowhere: .*--address {DEFAULT_ADDRESS}"):
        parse_view_address("nowhere", "--address")


@pytest.mark.parametrize("host", ["127.0.0.1", "[::1]", "[::]", "localhost"])
def test_the_url_carries_the_token_and_brackets(host: str) -> None:
    door = open_door(parse_view_address(f"{host}:0"))
    port = door.listening.getsockname()[1]
    assert door.url == f"http://{host}:{port}/{door.token}"


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("track star --view", f"track star --view={DEFAULT_ADDRESS}"),
        ("track --view star", f"track --view={DEFAULT_ADDRESS} star"),
        ("track --view --json star", f"track --view={DEFAULT_ADDRESS} --json star"),
        ("track star --view 0.0.0.0:80", "track star --view 0.0.0.0:80"),
        ("track star --view=0.0.0.0:80", "track star --view=0.0.0.0:80"),
        ("track star --view [::1]:80", "track star --view [::1]:80"),
        ("track star --view [::1]", "track star --view [::1]"),
        ("track star", "track star"),
        ("", ""),
    ],
)
def test_the_address_may_be_left_out(words: str, completed: str) -> None:
    assert with_default_address(words.split()) == completed.split()


def test_a_missing_package_gives_the_line_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ccr_host.view.live.find_spec", lambda _: None)
    with pytest.raises(ConfigError, match=r'pip install "ccr-host\[view\]"'):
        require_viser()
