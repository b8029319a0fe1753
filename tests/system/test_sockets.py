"""Every socket on which the program listens, and what becomes of whoever comes to it uninvited.

The table in SECURITY.md says the same in words.
"""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import pytest

from ccr_host.core.addresses import host_and_port
from tests.patience import PATIENCE_S
from tests.system.conftest import IN_REAL_TIME, PAPERS, CcrHost, acting
from tests.system.test_sweep import NARROW
from tests.system.warm_start import PipedProgram
from tests.viewer import Viewer

Address = tuple[str, int]
NOBODY = 65534
_LISTENS = {"tcp": "0A", "tcp6": "0A", "udp": "07", "udp6": "07"}
_UNIX_LISTENS = 0x10000


def processes(parent: int) -> list[int]:
    """A process and all that it has started."""
    found = [parent]
    for file in Path(f"/proc/{parent}/task").glob("*/children"):
        with suppress(OSError):
            found += [one for child in file.read_text().split() for one in processes(int(child))]
    return found


def listening(parent: int) -> set[Address]:
    """Addresses on which they listen; a socket in the file system is an error."""
    held = set()
    for process in processes(parent):
        for file in Path(f"/proc/{process}/fd").glob("*"):
            with suppress(OSError):
                held |= set(re.findall(r"socket:\[(\d+)\]", str(file.readlink())))
    for line in Path("/proc/net/unix").read_text().splitlines()[1:]:
        words = line.split()
        assert words[6] not in held or not int(words[3], 16) & _UNIX_LISTENS, line
    found = set()
    for kind, state in _LISTENS.items():
        for line in Path(f"/proc/net/{kind}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == state and words[9] in held:
                found.add(_address(words[1]))
    return found


def _address(text: str) -> Address:
    host, port = text.split(":")
    words = [bytes.fromhex(host[i : i + 8])[::-1] for i in range(0, len(host), 8)]
    family = socket.AF_INET if len(words) == 1 else socket.AF_INET6
    return socket.inet_ntop(family, b"".join(words)), int(port, 16)


_TALK = """
import json, socket, sys
host, port, messages = json.load(sys.stdin)
answers = []
for sent in messages:
    with socket.create_connection((host, port), 10) as one:
        one.settimeout(3)
        heard = b""
        try:
            one.sendall(sent.encode("latin-1"))
            while data := one.recv(65536):
                heard += data
        except OSError:
            pass
    answers.append(heard.decode("latin-1"))
print(json.dumps(answers))
"""


def said_by(address: Address, sent: str, *, as_nobody: bool = False) -> str:
    """What a socket answers, to another user of this computer where the tests may become one."""
    return answers_of(address, [sent], as_nobody=as_nobody)[0]


def answers_of(address: Address, sent: Sequence[str], *, as_nobody: bool = False) -> list[str]:
    """The same for several messages, each on a connection of its own."""
    command = [sys.executable, "-I", "-c", _TALK]
    if as_nobody:
        command = ["/usr/bin/python3", *command[1:]]
    user = NOBODY if as_nobody and os.geteuid() == 0 else None
    spoken = json.dumps([*address, sent])
    done = subprocess.run(
        command, input=spoken, capture_output=True, text=True, check=True, user=user
    )
    return list(json.loads(done.stdout))


def request(path: str = "/", **headers: str) -> str:
    lines = [f"GET {path} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
    return "\r\n".join([*lines, "", ""])


def upgrade(path: str, origin: str) -> str:
    """What a page of this origin has a browser send."""
    return request(
        path,
        Host="127.0.0.1",
        Origin=origin,
        Connection="Upgrade",
        Upgrade="websocket",
        **{"Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "A" * 22 + "=="},
    )


@contextmanager
def running(ccr_host: CcrHost, *words: str) -> Iterator[PipedProgram]:
    process = ccr_host.start(*words)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=PATIENCE_S)


@pytest.mark.parametrize("host", ["127.0.0.1", "[::1]"])
@pytest.mark.parametrize("command", ["track", "view"])
def test_the_page_is_the_only_socket_and_opens_to_its_token_alone(
    ccr_host: CcrHost, short_path: str, command: str, host: str
) -> None:
    words = ["track", "8shape", "--laps", "9", *PAPERS, *IN_REAL_TIME, "--no-open"]
    words += ["--realtime", "--view", f"{host}:0"]
    if command == "view":
        run = ccr_host("track", short_path, *PAPERS, "--no-open", "--out", "kept")
        assert run.status == 0
        words = ["view", "kept", "--address", f"{host}:0"]
    with running(ccr_host, *words) as process:
        assert process.stderr is not None
        url = re.search(rf"http://({re.escape(host)}:\d+)(/[\w-]+)", process.stderr.readline())
        assert url
        address, path = host_and_port(url[1], "", ""), url[2]
        assert not said_by(address, "x" * 100_000).startswith("HTTP/1.1 200")
        assert wait_for_page(address, path)
        assert listening(process.pid) == {address}
        for as_nobody in (False, True):
            uninvited = (
                request(),
                request("/index.html", Host="127.0.0.1"),
                request(path[:-1]),
                request(f"/?token={path[1:]}"),
                request(path, Host="127.0.0.1", Origin="http://evil.example"),
                upgrade("/", "http://127.0.0.1"),
                upgrade(path, "http://evil.example"),
                upgrade(path, "null"),
                "POST / HTTP/1.1\r\n\r\n",
                "\x16\x03\x01\x02\x00\r\n\r\n",
                "x" * 100_000,
            )
            answers = answers_of(address, uninvited, as_nobody=as_nobody)
            for sent, answer in zip(uninvited, answers, strict=True):
                assert re.match(r"(HTTP/1.1 (403|40\d|501) )|$", answer), sent
                assert "viser" not in answer, sent
        with Viewer(url[0]) as viewer:
            for message in (b"\xc1", "text", {"type": "GuiUpdateMessage"}, {"type": "Message"}):
                viewer.say(message)
        for number in processes(process.pid):
            assert path[1:] not in Path(f"/proc/{number}/cmdline").read_text(), "as ps shows it"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
        told = [line for line in err.splitlines() if not line.startswith("ccr-host: interrupted")]
        assert told == [], "nothing is printed about any of it"


def wait_for_page(address: Address, path: str) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        if said_by(address, request(path)).startswith("HTTP/1.1 200 "):
            return True
    return False


def test_no_socket_of_a_sweep_answers_a_stranger(ccr_host: CcrHost, short_path: str) -> None:
    waits = acting(ccr_host.folder, "time.sleep(600)", 1)
    words = ("--path", short_path, *waits, "--rate", "1", "--runs", "2", *NARROW)
    with running(ccr_host, "sweep", *words, "--workers", "1", "--out", "kept") as process:
        deadline = time.monotonic() + PATIENCE_S
        while len(found := listening(process.pid)) < 5 and time.monotonic() < deadline:
            time.sleep(0.2)
        assert found
        assert {host for host, _ in found} == {"127.0.0.1"}
        asked = request("/info/main/workers.html", Host="127.0.0.1", Connection="close")
        with ThreadPoolExecutor(len(found)) as crowd:
            for as_nobody in (False, True):
                ask = partial(said_by, sent=asked, as_nobody=as_nobody)
                for address, answer in zip(found, crowd.map(ask, found), strict=True):
                    assert not re.match("HTTP/1.1 (?!404)", answer), (address, answer)
            assert not any(crowd.map(shakes_hands, found))


def shakes_hands(address: Address) -> bool:
    """Whether a client without a certificate is accepted."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    with (
        suppress(OSError),
        socket.create_connection(address, 10) as plain,
        context.wrap_socket(plain) as guarded,
    ):
        guarded.settimeout(3)
        return bool(guarded.recv(1))
    return False


def test_an_emulated_board_and_camera_listen_where_they_say_and_nowhere_else(
    ccr_host: CcrHost, short_path: str
) -> None:
    words = ("emulate", "--tcp", "[::1]:0", "--polaris-tcp", "127.0.0.1:0")
    with running(ccr_host, *words) as process:
        assert process.stdout is not None
        told = [process.stdout.readline() for _ in range(3)]
        uris = re.findall(r"//(\S+:\d+)", " ".join(told[:2]))
        places = {host_and_port(uri, "", "") for uri in uris}
        assert listening(process.pid) == places
        for place in places:
            posted = "POST / HTTP/1.1\r\nOrigin: http://evil.example\r\n\r\nINIT \r"
            assert said_by(place, posted) == "", "web pages are sent away"
        line = told[2].replace("8shape", short_path).split()[2:]
        run = ccr_host(*line, *PAPERS, *IN_REAL_TIME, "--no-open", "--json")
        assert run.status == 0, run.err


@pytest.mark.parametrize(
    "words",
    [
        ("emulate",),
        ("emulate", "--polaris"),
        ("track", "8shape", *PAPERS, "--no-open", "--realtime", "--tracker", "ndi-emulator:"),
        ("track", "8shape", *PAPERS, "--realtime", "--device", "emulator+pty:"),
    ],
)
def test_all_else_listens_nowhere(ccr_host: CcrHost, words: tuple[str, ...]) -> None:
    with running(ccr_host, *words) as process:
        time.sleep(4)
        assert process.poll() is None
        assert listening(process.pid) == set()
