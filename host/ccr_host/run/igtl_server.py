"""``--publish igtl://HOST:PORT``: a run as an OpenIGTLink server, for 3D Slicer and PLUS.

The control loop only leaves its newest values here. A thread packs and sends them; it never waits
for a client: one that does not read misses pictures, one that reads nothing for long is dropped.
"""

from __future__ import annotations

import json
import selectors
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import Any

import numpy as np

from ccr_host.control.base import Command, Observation, Phase
from ccr_host.core.addresses import host_and_port, joined, listening_socket
from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError, full_text
from ccr_host.core.plugins import import_optional
from ccr_host.core.standard_streams import warn
from ccr_host.link.messages import StateReport
from ccr_host.robot.backbone import (
    fitted_bending_rad,
    marker_feet_mm,
    measured_backbone_mm,
)
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.run.observer import RunObserver, RunSetup
from ccr_host.tracking.tracker import Sample

FORM = "igtl://[HOST]:PORT"
DEFAULT_HOST = "127.0.0.1"
PERIOD_S = 0.05
"""Time between two pictures; cameras take 20 to 60 a second."""
MOST_CLIENTS = 8
_PATIENCE = 200
"""Pictures that a client may miss in a row, ten seconds, before it is dropped."""
_READ_BYTES = 4096
_UNREAD_BYTES = 1 << 15
"""Some pictures of 4 kB: a slow client is shown the present, not what was seconds ago."""
_BACKBONE_POINTS = 21


def parse_publish_uri(text: str) -> tuple[str, int]:
    """Host and port of ``igtl://[HOST]:PORT``; this computer alone unless a host is given.

    Raises:
        ConfigError: it is not one.
    """
    scheme, colon, rest = text.partition("://")
    if not colon or scheme.lower() != "igtl":
        raise ConfigError(f"--publish {text}: unknown form", f"write {FORM}, e.g. igtl://:18944")
    if rest.startswith(":"):
        rest = DEFAULT_HOST + rest
    return host_and_port(rest, f"--publish {text}", "igtl://:18944", 0)


class RunPicture(RunObserver):
    """Observer that keeps the newest values of a run, each replaced at once."""

    def __init__(self) -> None:
        self.version = 0
        """Counts the changes."""
        self._model: ConstantCurvature | None = None
        self._sample: Sample | None = None
        self._commanded_rad: Array | None = None
        self._target_mm: Array | None = None
        self._state: StateReport | None = None
        self._phase = ""
        self._now_us = 0

    def begin(self, setup: RunSetup) -> None:
        self._model, self._reference = ConstantCurvature(setup.description.robot), setup.reference

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        self._sample = sample
        self._changed(time_us)

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        self._commanded_rad = command.q_rad
        self._target_mm = self._reference.target_mm[0 if observation is None else observation.step]
        self._changed(time_us)

    def state(self, time_us: int, report: StateReport) -> None:
        self._state = report
        self._changed(time_us)

    def phase(self, time_us: int, phase: Phase) -> None:
        self._phase = phase.name
        self._changed(time_us)

    def messages(self, pyigtl: Any) -> list[Any]:  # noqa: ANN401 - a module without types
        """What is known now, as messages of pyigtl; called in another thread."""
        sample, target_mm, now_s = self._sample, self._target_mm, self._now_us * 1e-6
        found = []
        if target_mm is not None:
            found.append(_transform(pyigtl, "DesiredToBase", np.eye(3), target_mm, now_s))
        if sample is not None and self._model is not None and np.isfinite(sample.markers_mm).all():
            found += self._shape(pyigtl, self._model, sample)
        text = json.dumps(self._told(sample, target_mm))
        found.append(pyigtl.StringMessage(text, timestamp=now_s, device_name="State"))
        return found

    def _shape(self, pyigtl: Any, model: ConstantCurvature, sample: Sample) -> Iterator[Any]:  # noqa: ANN401
        straight_rad = np.zeros(model.motors)
        commanded_rad = straight_rad if self._commanded_rad is None else self._commanded_rad
        markers_mm, time_s = sample.markers_mm, sample.exposed_us * 1e-6
        bending_rad = fitted_bending_rad(model, markers_mm, model.bending_rad(commanded_rad))
        turns = model.disk_turns(bending_rad)
        yield _transform(pyigtl, "TipToBase", turns[-1], sample.tip_mm, time_s)
        for number, disk_mm in enumerate(marker_feet_mm(model, markers_mm, bending_rad)):
            yield _transform(pyigtl, f"Disk{number}ToBase", turns[number], disk_mm, time_s)
        curve_mm = measured_backbone_mm(model, markers_mm, bending_rad, _BACKBONE_POINTS)
        yield pyigtl.PointMessage(
            positions=curve_mm,
            names=[f"B{number}" for number in range(len(curve_mm))],
            groups="Backbone",
            timestamp=time_s,
            device_name="Backbone",
        )

    def _told(self, sample: Sample | None, target_mm: Array | None) -> dict[str, Any]:
        state = self._state
        error_mm = None
        if sample is not None and target_mm is not None and np.isfinite(sample.tip_mm).all():
            error_mm = round(float(np.linalg.norm(sample.tip_mm - target_mm)), 3)
        return {
            "phase": self._phase,
            "state": None if state is None else state.state.name.lower(),
            "fault": None if state is None else state.fault.name.lower(),
            "time_s": self._now_us * 1e-6,
            "error_mm": error_mm,
        }

    def _changed(self, time_us: int) -> None:
        self._now_us = time_us
        self.version += 1


def _transform(pyigtl: Any, name: str, turn: Array, at_mm: Array, time_s: float) -> Any:  # noqa: ANN401
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, at_mm
    return pyigtl.TransformMessage(matrix, timestamp=time_s, device_name=name)


class _Client:
    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _UNREAD_BYTES)
        self.connection = connection
        self._pending = b""
        self._missed = 0

    def is_gone(self) -> bool:
        """Read and forget what it sends; whether it has left."""
        try:
            return not self.connection.recv(_READ_BYTES)
        except BlockingIOError:
            return False
        except OSError:
            return True

    def is_lost(self, picture: bytes) -> bool:
        """Send what fits now, of an earlier picture first; whether to give up on this client."""
        if not self._pending:
            self._pending, self._missed = picture, 0
        self._missed += 1
        try:
            while self._pending:
                self._pending = self._pending[self.connection.send(self._pending) :]
                self._missed = 0
        except BlockingIOError:
            pass
        except OSError:
            return True
        return self._missed > _PATIENCE


class IgtlServer:
    """Serves a picture of the run to all clients, in a thread of its own.

    ``pyigtl`` is the package, which packs the messages.
    """

    def __init__(self, listening: socket.socket, pyigtl: Any) -> None:  # noqa: ANN401
        listening.setblocking(False)
        self._listening = listening
        self._pyigtl = pyigtl
        self._clients: list[_Client] = []
        self._ends = Event()
        host, port = listening.getsockname()[:2]
        self.address = joined(host, port)
        self.observer = RunPicture()
        self._thread = Thread(target=self._serve, daemon=True, name="OpenIGTLink server")
        self._thread.start()

    def close(self) -> None:
        """Send the last picture to those who read, and disconnect all."""
        self._ends.set()
        self._thread.join()

    def _serve(self) -> None:
        try:
            self._serve_until_closed()
        except Exception as error:
            warn(f"the OpenIGTLink server has ended: {full_text(error)}; the run goes on")

    def _serve_until_closed(self) -> None:
        shown = -1
        with selectors.DefaultSelector() as selector, self._listening:
            selector.register(self._listening, selectors.EVENT_READ)
            while True:
                is_last = self._ends.wait(PERIOD_S)
                clients = len(self._clients)
                for key, _ in selector.select(0):
                    self._look_at(selector, key)
                if len(self._clients) > clients:
                    shown = -1
                if self._clients and (is_last or shown != self.observer.version):
                    shown = self.observer.version
                    self._show(selector)
                if is_last:
                    break
            for client in self._clients:
                client.connection.close()

    def _look_at(self, selector: selectors.BaseSelector, key: selectors.SelectorKey) -> None:
        client: _Client | None = key.data
        if client is not None:
            if client.is_gone():
                self._drop(selector, client)
            return
        with suppress(OSError):
            connection, _ = self._listening.accept()
            if len(self._clients) >= MOST_CLIENTS:
                connection.close()
                return
            client = _Client(connection)
            self._clients.append(client)
            selector.register(connection, selectors.EVENT_READ, client)

    def _show(self, selector: selectors.BaseSelector) -> None:
        picture = b"".join(one.pack() for one in self.observer.messages(self._pyigtl))
        for client in list(self._clients):
            if client.is_lost(picture):
                self._drop(selector, client)

    def _drop(self, selector: selectors.BaseSelector, client: _Client) -> None:
        selector.unregister(client.connection)
        client.connection.close()
        self._clients.remove(client)


@contextmanager
def published(uri: str) -> Iterator[IgtlServer]:
    """Serve at ``igtl://[HOST]:PORT`` until the context ends.

    Raises:
        ConfigError: no such form, the address cannot be had, or pyigtl is not installed.
    """
    host, port = parse_publish_uri(uri)
    pyigtl = import_optional("pyigtl", "igtl", f"--publish {uri}")
    server = IgtlServer(listening_socket(host, port), pyigtl)
    try:
        yield server
    finally:
        server.close()
