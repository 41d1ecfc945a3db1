"""Starts, watches and stops the processes of a flight with supervisord."""

import os
import subprocess
import sys
import time
import xmlrpc.client
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from supervisor.xmlrpc import SupervisorTransport  # pyright: ignore[reportMissingTypeStubs]

CONF = "supervisord.conf"
SOCKET = "supervisor.sock"
SAID = "supervisord.said"
"""What supervisord says before it has a log."""
START_TIMEOUT_S = 20.0
STOP_WAIT_S = 3
SPELLED = {"#": "JUNCNET_HASH", ";": "JUNCNET_SEMICOLON", "\n": "JUNCNET_NEWLINE"}
"""Characters that would end a value in supervisord's configuration, for which it knows no escape:
each stands in an environment variable, of supervisord's, that the configuration names instead."""

_HEAD = """\
[supervisord]
nodaemon={nodaemon}
directory={directory}
logfile={directory}/supervisord.log
logfile_maxbytes=2MB
pidfile={directory}/supervisord.pid
childlogdir={directory}
identifier=juncnet

[unix_http_server]
file={directory}/{socket}
chmod=0700

[rpcinterface:supervisor]
supervisor.rpcinterface_factory=supervisor.rpcinterface:make_main_rpcinterface

[supervisorctl]
serverurl=unix://{directory}/{socket}
"""

# A process that ends with 0 has done its work, with 2 it is misconfigured; any other end is a fault
# and starts it anew, with supervisor's growing delay between attempts that live under a second.
_PROGRAM = """
[program:{name}]
command={python} -m juncnet_services.{name} {arguments}
directory={here}
autorestart=unexpected
exitcodes=0,2
startsecs=1
startretries=1000
stopsignal=TERM
stopwaitsecs={stop_wait_s}
stdout_logfile={directory}/{name}.log
stdout_logfile_maxbytes=2MB
stdout_logfile_backups=1
redirect_stderr=true
"""


@dataclass(frozen=True)
class ProcessStatus:
    """What the supervisor says of one process."""

    name: str
    state: str
    pid: int
    uptime_s: float


def configuration(
    directory: Path, processes: tuple[str, ...], arguments: list[str], *, foreground: bool
) -> str:
    """Return supervisord's configuration for these processes, all started with `arguments`.

    `directory` is the flight directory: sockets, logs and pid files lie there. The processes work
    where this one does, so that relative paths in their options mean what they say.
    """
    quoted = " ".join(_quote(a) for a in arguments)
    where = _spelled(str(directory))
    head = _HEAD.format(directory=where, socket=SOCKET, nodaemon="true" if foreground else "false")
    return head + "".join(
        _PROGRAM.format(
            name=name,
            python=_quote(sys.executable),
            arguments=quoted,
            directory=where,
            here=_spelled(str(Path.cwd())),
            stop_wait_s=STOP_WAIT_S,
        )
        for name in processes
    )


def _quote(argument: str) -> str:
    # supervisor splits with shlex
    return "'" + _spelled(argument.replace("'", "'\"'\"'")) + "'"


def _spelled(text: str) -> str:
    """Return `text` as supervisord's configuration has it: expanded, it is `text` again."""
    text = text.replace("%", "%%")
    for character, variable in SPELLED.items():
        text = text.replace(character, f"%(ENV_{variable})s")
    return text


class Supervisor:
    """A supervisord of one flight, by its flight directory."""

    def __init__(self, directory: Path):
        self.directory = directory
        self._process: subprocess.Popen[bytes] | None = None

    def _call(self, method: str) -> object:
        """Return the answer of supervisord; a transport that failed once is of no further use.

        Raises:
            OSError: it is not there.
            xmlrpc.client.Error: it refused.
        """
        transport = SupervisorTransport(None, None, f"unix://{self.directory / SOCKET}")
        with xmlrpc.client.ServerProxy("http://127.0.0.1", transport=transport) as proxy:
            return getattr(proxy.supervisor, method)()

    def start(self, processes: tuple[str, ...], arguments: list[str], *, foreground: bool) -> None:
        """Start supervisord and with it all processes.

        `foreground`: as a child of this process, which `stop` must be called for; else detached.

        Raises:
            RuntimeError: it did not start; the text has the end of its log.
        """
        conf = self.directory / CONF
        conf.write_text(configuration(self.directory, processes, arguments, foreground=foreground))
        said = self.directory / SAID
        with said.open("wb") as errors:
            self._process = subprocess.Popen(
                # -P: no module of the user's folder stands in for one of Python's
                [sys.executable, "-P", "-m", "supervisor.supervisord", "-c", str(conf)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,
                env=os.environ | {variable: character for character, variable in SPELLED.items()},
            )
        deadline = time.monotonic() + START_TIMEOUT_S
        while time.monotonic() < deadline:
            if self.running:
                if not foreground:  # what we started has only started the supervisor, and ends
                    self._process.wait(START_TIMEOUT_S)
                return
            if self._process.poll():
                break
            time.sleep(0.05)
        log = self.directory / "supervisord.log"
        told = (log if log.exists() else said).read_text(errors="replace")
        tail = told[-2000:].strip() or "it wrote no log"
        raise RuntimeError(f"supervisord did not start: {tail}")

    @property
    def running(self) -> bool:
        """Whether supervisord answers."""
        try:
            self._call("getState")
        except (OSError, xmlrpc.client.Error):
            return False
        return True

    def _lives(self) -> bool:
        """Return whether supervisord's process exists: it answers no more once it shuts down.

        It ends after all its processes have, and leaves none of them behind as a zombie.
        """
        try:
            pid = int((self.directory / "supervisord.pid").read_text())
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
        except (OSError, ValueError):
            return False
        return str(self.directory / CONF).encode() in words

    def status(self) -> list[ProcessStatus]:
        """Return the state of every process; empty when supervisord does not answer."""
        try:
            rows = cast("list[dict[str, Any]]", self._call("getAllProcessInfo"))
        except (OSError, xmlrpc.client.Error):
            return []
        return [
            ProcessStatus(
                name=str(row["name"]),
                state=str(row["statename"]),
                pid=int(row["pid"]),
                uptime_s=float(max(0, row["now"] - row["start"])) if row["pid"] else 0.0,
            )
            for row in rows
        ]

    def restarts(self) -> dict[str, int]:
        """Return how often each process was started again, from supervisord's log."""
        log = self.directory / "supervisord.log"
        counts: dict[str, int] = {}
        for line in log.read_text().splitlines() if log.exists() else ():
            if "INFO spawned: '" in line:
                name = line.split("INFO spawned: '")[1].split("'")[0]
                counts[name] = counts.get(name, -1) + 1
        return counts

    def stop(self) -> None:
        """Stop all processes and supervisord, and wait until they are gone."""
        try:
            self._call("shutdown")
        except (OSError, xmlrpc.client.Error):
            if self._process is not None:  # it does not answer yet
                self._process.terminate()
        deadline = time.monotonic() + 3 * STOP_WAIT_S + 10
        while (self.running or self._lives()) and time.monotonic() < deadline:
            time.sleep(0.05)
        if self._process is not None:
            try:
                self._process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                self._process.kill()
