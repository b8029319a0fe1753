"""Who may see the page and press its buttons.

The page's server itself asks nobody for anything. Without these checks any web site open in the
same browser could connect to it (WebSockets know no same-origin policy), and on a network anybody.
"""

from __future__ import annotations

import enum
import hmac
import re
from dataclasses import dataclass
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

_REQUEST_LINE = re.compile(r"GET (/[^ ]*) [^ ]*")
_LOCAL_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
_COOKIE = "ccr_host_view"


class BadRequestError(Exception):
    """These bytes are no HTTP request."""


@dataclass(frozen=True)
class RequestHead:
    """The first lines of an HTTP request."""

    target: str
    headers: dict[str, str]
    """Names in lower case; of repeated ones the last."""

    @classmethod
    def parse(cls, data: bytes) -> RequestHead:
        """Read everything up to the empty line.

        Raises:
            BadRequestError: it is not what a browser sends.
        """
        first, *lines = data.decode("latin-1").rstrip("\r\n").split("\r\n")
        request = _REQUEST_LINE.fullmatch(first)
        if request is None:
            raise BadRequestError
        headers = {}
        for line in lines:
            name, colon, value = line.partition(":")
            if not colon:
                raise BadRequestError
            headers[name.strip().lower()] = value.strip()
        return cls(request[1], headers)


class Verdict(enum.Enum):
    """What becomes of a request."""

    ADMITTED = enum.auto()
    WELCOMED = enum.auto()
    """The token came with the address: keep it in a cookie and take it out of the address."""
    REFUSED = enum.auto()


@dataclass(frozen=True)
class Admission:
    """The rule.

    Args:
        token: that a visitor must show; None where only this machine reaches the page.
    """

    token: str | None

    def judge(self, request: RequestHead) -> Verdict:
        """Decide on one request, page or WebSocket."""
        try:
            return self._verdict(request)
        except ValueError:  # an address that is none
            return Verdict.REFUSED

    def _verdict(self, request: RequestHead) -> Verdict:
        if not self._is_from_this_page(request):
            return Verdict.REFUSED
        if self.token is None:
            return Verdict.ADMITTED
        if self._is_token(_cookie_of(request)):
            return Verdict.ADMITTED
        shown = parse_qs(urlsplit(request.target).query).get("token", [""])[0]
        return Verdict.WELCOMED if self._is_token(shown) else Verdict.REFUSED

    def welcome(self) -> bytes:
        """Answer to a visitor who has shown the token."""
        cookie = f"{_COOKIE}={self.token}; Path=/; HttpOnly; SameSite=Strict"
        return _response(HTTPStatus.SEE_OTHER, ("Location: /", f"Set-Cookie: {cookie}"))

    def _is_from_this_page(self, request: RequestHead) -> bool:
        host = request.headers.get("host", "")
        origin = request.headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return False
        # A name that a stranger's DNS has pointed at this machine is not one of ours.
        return self.token is not None or urlsplit(f"//{host}").hostname in _LOCAL_NAMES

    def _is_token(self, shown: str) -> bool:
        return hmac.compare_digest(shown.encode(), (self.token or "").encode())


def refusal(status: HTTPStatus) -> bytes:
    """Answer to whoever is not admitted."""
    text = "Open the address that ccr-host has printed, with its token.\n"
    return _response(status, ("Content-Type: text/plain",), text)


def _response(status: HTTPStatus, headers: tuple[str, ...], text: str = "") -> bytes:
    lines = (
        f"HTTP/1.1 {status.value} {status.phrase}",
        *headers,
        f"Content-Length: {len(text)}",
        "Cache-Control: no-store",
        "Connection: close",
    )
    return ("\r\n".join(lines) + "\r\n\r\n" + text).encode("ascii")


def _cookie_of(request: RequestHead) -> str:
    try:
        cookie = SimpleCookie(request.headers.get("cookie", "")).get(_COOKIE)
    except CookieError:
        return ""
    return "" if cookie is None else cookie.value
