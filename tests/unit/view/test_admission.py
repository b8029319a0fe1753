from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.view.admission import Admission, BadRequestError, RequestHead, Verdict

OPEN = Admission(token=None)
GUARDED = Admission(token="s3cret-token")


def request(target: str = "/", **headers: str) -> RequestHead:
    named = {"Host": "127.0.0.1:8642"} | {k.capitalize(): v for k, v in headers.items()}
    lines = [f"GET {target} HTTP/1.1", *(f"{name}: {value}" for name, value in named.items())]
    return RequestHead.parse(("\r\n".join(lines) + "\r\n\r\n").encode())


@pytest.mark.parametrize("host", ["127.0.0.1:8642", "localhost:8642", "localhost:9", "[::1]:8642"])
def test_this_machine_needs_no_token_and_a_tunnel_may_change_the_port(host: str) -> None:
    assert OPEN.judge(request(host=host)) is Verdict.ADMITTED


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8642", "127.0.0.1.evil.org", ""])
def test_a_name_that_points_here_by_somebody_elses_dns_is_refused(host: str) -> None:
    assert OPEN.judge(request(host=host)) is Verdict.REFUSED


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://127.0.0.1:3000", "null", "http://localhost:8642"]
)
@pytest.mark.parametrize("admission", [OPEN, GUARDED])
def test_another_page_in_the_same_browser_is_refused(admission: Admission, origin: str) -> None:
    cookie = "ccr_host_view=s3cret-token"
    assert admission.judge(request(origin=origin, cookie=cookie)) is Verdict.REFUSED


def test_the_page_itself_is_admitted() -> None:
    assert OPEN.judge(request(origin="http://127.0.0.1:8642")) is Verdict.ADMITTED


@pytest.mark.parametrize(
    ("target", "cookie", "verdict"),
    [
        ("/", "", Verdict.REFUSED),
        ("/?token=", "", Verdict.REFUSED),
        ("/?token=wrong", "ccr_host_view=wrong", Verdict.REFUSED),
        ("/?token=s3cret-token", "", Verdict.WELCOMED),
        ("/", "ccr_host_view=s3cret-token", Verdict.ADMITTED),
        ("/", "other=1; ccr_host_view=s3cret-token", Verdict.ADMITTED),
        ("/?token=%C3%A9", "", Verdict.REFUSED),
    ],
)
def test_the_token_is_shown_once_and_then_kept_in_a_cookie(
    target: str, cookie: str, verdict: Verdict
) -> None:
    assert GUARDED.judge(request(target, host="lab.example:8642", cookie=cookie)) is verdict


def test_the_welcome_takes_the_token_out_of_the_address() -> None:
    answer = GUARDED.welcome().decode()
    assert "303" in answer.splitlines()[0]
    assert "Location: /\r\n" in answer
    assert "HttpOnly" in answer
    assert "SameSite=Strict" in answer


@given(st.text(), st.text(), st.text(), st.text())
def test_no_request_is_too_strange_to_judge(
    target: str, host: str, origin: str, cookie: str
) -> None:
    strange = RequestHead(target, {"host": host, "origin": origin, "cookie": cookie})
    assert GUARDED.judge(strange) is Verdict.REFUSED


@pytest.mark.parametrize("host", ["[", "[::1", "//", "127.0.0.1:x"])
def test_a_host_that_is_none_is_refused(host: str) -> None:
    assert GUARDED.judge(request(host=host)) is Verdict.REFUSED


@given(st.binary())
def test_bytes_make_a_request_or_a_bad_one(data: bytes) -> None:
    with suppress(BadRequestError):
        assert RequestHead.parse(b"GET /" + data).target.startswith("/")


@pytest.mark.parametrize(
    "data", [b"", b"\r\n\r\n", b"POST / HTTP/1.1\r\n\r\n", b"GET http://x/ HTTP/1.1\r\n\r\n",
             b"GET / HTTP/1.1\r\nno colon\r\n\r\n", b"\x16\x03\x01\x02\x00\r\n\r\n"]
)  # fmt: skip
def test_what_no_browser_sends_is_no_request(data: bytes) -> None:
    with pytest.raises(BadRequestError):
        RequestHead.parse(data)
