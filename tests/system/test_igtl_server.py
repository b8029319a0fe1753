"""`track --publish`, read by OpenIGTLink's own library (libopenigtlink), which checks every CRC."""

import json
import re
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ccr_host.core.addresses import host_and_port
from ccr_host.record.log import topics
from tests.patience import PATIENCE_S
from tests.system.conftest import IN_REAL_TIME, PAPERS, CcrHost, logged, wait_until_following
from tests.system.test_sockets import listening, running

PICTURES = 20
NAMES = (
    "DesiredToBase", "TipToBase", "Disk0ToBase", "Disk1ToBase", "Disk2ToBase", "Backbone", "State",
)  # fmt: skip


@pytest.fixture
def reader(tmp_path: Path) -> Path:
    program = tmp_path / "igtl_reader"
    source = Path(__file__).with_name("igtl_reader.cpp")
    subprocess.run(
        ["g++", str(source), "-I/usr/include/openigtlink", "-lOpenIGTLink", "-lpthread",
         "-o", str(program)], check=True,
    )  # fmt: skip
    return program


def test_openigtlinks_own_library_reads_what_the_log_holds_beside_a_dead_client(
    ccr_host: CcrHost, reader: Path
) -> None:
    words = (
        "track",
        "8shape",
        *PAPERS,
        *IN_REAL_TIME,
        "--no-open",
        "--realtime",
        "--publish",
        "igtl://:0",
    )
    with running(ccr_host, *words, "--out", "kept") as process:
        assert process.stderr is not None
        told = re.search(r"igtl://(\S+)", process.stderr.readline())
        assert told
        wait_until_following(ccr_host.folder / "kept", process)
        host, port = host_and_port(told[1], "", "")
        assert listening(process.pid) == {(host, port)} == {("127.0.0.1", port)}
        with socket.create_connection((host, port)):  # never reads, never leaves
            count = PICTURES * len(NAMES)
            read = subprocess.run(
                [reader, host, str(port), str(count)],
                capture_output=True, text=True, check=True, timeout=PATIENCE_S,
            ).stdout  # fmt: skip
    lines = [line.split(" ", 3) for line in read.splitlines()]
    assert len(lines) == count
    assert {name for _, name, *_ in lines} == set(NAMES)
    tips_mm = {
        round(float(stamp_s) * 1e6): np.array(values.split(), dtype=float).reshape(3, 4)[:, 3]
        for _, name, stamp_s, values in lines
        if name == "TipToBase"
    }
    samples = {
        content["exposed_us"]: np.array(content["markers_mm"])
        for content in logged(ccr_host.folder / "kept", topics.SAMPLE)
    }
    known = set(tips_mm) & set(samples)
    assert len(known) > 3
    for exposed_us in known:
        logged_mm = samples[exposed_us][2] - samples[exposed_us][0]
        assert tips_mm[exposed_us] == pytest.approx(logged_mm, abs=1e-3)
    states = [json.loads(values) for kind, *_, values in lines if kind == "STRING"]
    assert {state["fault"] for state in states} <= {None, "none"}
    assert states[-1]["phase"]
