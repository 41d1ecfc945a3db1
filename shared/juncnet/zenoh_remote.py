"""The links of a process to the vehicle's router, from a host that is not the vehicle.

Two client sessions, so that a picture never delays a command: their TCP connections have buffers of
their own, in Zenoh and in the kernel, where priority alone would not help. They are opened in the
background, again and again until the vehicle is there; once open Zenoh reopens them itself.
"""

import contextlib
import json
import threading
from collections.abc import Callable
from typing import Any

import zenoh

from juncnet.links import RemoteSettings
from juncnet.topics import Qos

RETRY_S = 0.2
"""Pause between attempts to reach the vehicle."""
Declare = Callable[[zenoh.Session], None]


class RemoteSession:
    """A client session that is open as soon as it can be; `problem` hears why it is not."""

    def __init__(self, settings: dict[str, Any], problem: Callable[[str], None]) -> None:
        self._config = json.dumps(settings)
        self._problem = problem
        self._lock = threading.Lock()
        self._open: zenoh.Session | None = None
        self._pending: list[Declare] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._connect, name="link", daemon=True)
        self._thread.start()

    @property
    def session(self) -> zenoh.Session | None:
        """The session; None until it was open for the first time."""
        return self._open

    @property
    def linked(self) -> bool:
        """Whether the router is reached now."""
        session = self._open
        return session is not None and bool(session.info.routers_zid())

    def when_open(self, declare: Declare) -> None:
        """Call `declare` with the session now, or once it is open, in another thread."""
        with self._lock:
            if self._open is None:
                self._pending.append(declare)
                return
        declare(self._open)

    def close(self) -> None:
        """End the link, or the attempts to make it."""
        self._closing.set()
        self._thread.join()
        if self._open is not None:
            with contextlib.suppress(zenoh.ZError):
                self._open.close()  # pyright: ignore[reportUnknownMemberType]

    def _connect(self) -> None:
        while not self._closing.is_set():
            try:
                session = zenoh.open(zenoh.Config.from_json5(self._config))
            except zenoh.ZError as error:
                self._problem(f"the vehicle's router is not reached: {error}")
                self._closing.wait(RETRY_S)
                continue
            with self._lock:
                for declare in self._pending:
                    declare(session)
                self._pending.clear()
                self._open = session
            return


class RemoteLink:
    """The control session, and the bulk session once something needs it."""

    def __init__(self, settings: RemoteSettings, problem: Callable[[str], None]) -> None:
        self._settings, self._problem = settings, problem
        self._lock = threading.Lock()
        self._control = RemoteSession(settings.control, problem)
        self._bulk: RemoteSession | None = None

    @property
    def control(self) -> RemoteSession:
        """The session of everything that is small and urgent."""
        return self._control

    def of(self, qos: Qos) -> RemoteSession:
        """Return the session on which topics of this kind travel."""
        if qos is not Qos.BULK:
            return self._control
        with self._lock:
            if self._bulk is None:
                self._bulk = RemoteSession(self._settings.bulk, self._problem)
            return self._bulk

    def close(self) -> None:
        """End both sessions."""
        self._control.close()
        if self._bulk is not None:
            self._bulk.close()
