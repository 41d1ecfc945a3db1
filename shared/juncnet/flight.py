"""A flight: one start of a layout, and the private directory in which its processes meet.

Everything that the processes of a flight share on this host lies in its directory or carries its
`tag`, so two flights never hear each other, and what killed processes left behind is recognised.
"""

import hashlib
import json
import os
import platform
import secrets
import subprocess
import tempfile
import time
import uuid
from dataclasses import asdict, dataclass
from pathlib import Path

SAVED_AS = "flight.json"
SOCKET_PATH_LIMIT = 107
"""Bytes of a Unix socket's path on Linux."""
BOOT = Path("/proc/sys/kernel/random/boot_id")
TIME_NAMESPACE = Path("/proc/self/ns/time")
INITIAL_TIME_NAMESPACE = 0xEFFFFFFA
"""Inode of the time namespace of Linux that is not a container's."""
LONGEST_SOCKET = "/" + 32 * "x" + ".zsock.lock"


@dataclass(frozen=True)
class Flight:
    """Who takes part in a flight, and where: `id`, robot, names of the processes on this host."""

    id: str
    directory: Path
    robot: str
    processes: tuple[str, ...]

    @property
    def tag(self) -> str:
        """Short name of the directory: what the flight's shared memory is called after."""
        return "jn" + hashlib.sha256(str(self.directory.resolve()).encode()).hexdigest()[:8]

    @property
    def is_saved(self) -> bool:
        """Whether the directory is a flight's."""
        return (self.directory / SAVED_AS).is_file()

    def socket_path(self, process: str) -> Path:
        """Return the Unix socket on which `process` listens."""
        return self.directory / f"{process}.zsock"

    def socket(self, process: str) -> str:
        """Return the Zenoh endpoint on which `process` listens."""
        return f"unixsock-stream/{self.socket_path(process)}"

    def save(self) -> None:
        """Write `flight.json` into the directory; whoever starts there later joins this flight."""
        fields = asdict(self) | {"directory": str(self.directory)}
        path = self.directory / SAVED_AS
        draft = path.with_suffix(f".{os.getpid()}")
        draft.write_text(json.dumps(fields, indent=2) + "\n")
        draft.replace(path)


def flights_root() -> Path:
    """Return where this user's flights live, created if need be: /run/user/... or /tmp."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and os.access(runtime, os.W_OK):
        root = Path(runtime) / "juncnet"
    else:
        root = Path(tempfile.gettempdir()) / f"juncnet-{os.getuid()}"
    root.mkdir(mode=0o700, parents=True, exist_ok=True)
    if root.stat().st_uid != os.getuid():
        raise PermissionError(f"{root} belongs to another user: set XDG_RUNTIME_DIR")
    return root


def new_flight(robot: str, processes: tuple[str, ...], root: Path | None = None) -> Flight:
    """Return a flight in a new private directory under `root` (default: `flights_root()`)."""
    name = time.strftime("%Y%m%d-%H%M%S-") + secrets.token_hex(2)
    return join_flight((root or flights_root()) / name, robot, processes)


def join_flight(directory: Path, robot: str, processes: tuple[str, ...]) -> Flight:
    """Return the flight of `directory`; the first to come makes it.

    Raises:
        ValueError: the path is too long for sockets in it, or the flight is another robot's.
    """
    directory = directory.absolute()
    if len(str(directory) + LONGEST_SOCKET) > SOCKET_PATH_LIMIT:
        raise ValueError(f"{directory}: too long for sockets in it, use a shorter path")
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        flight = read_flight(directory)
    except FileNotFoundError:
        flight = Flight(directory.name, directory, robot, processes)
        flight.save()
    if flight.robot != robot:
        raise ValueError(f"{directory} is a flight of robot {flight.robot!r}, not {robot!r}")
    return flight


def read_flight(directory: Path) -> Flight:
    """Return the flight of an existing flight directory.

    Raises:
        FileNotFoundError: there is none.
    """
    if not (directory / SAVED_AS).is_file():
        raise FileNotFoundError(f"{directory} is no flight's directory: it has no {SAVED_AS}")
    fields = json.loads((directory / SAVED_AS).read_text())
    return Flight(
        str(fields["id"]), directory.absolute(), str(fields["robot"]), tuple(fields["processes"])
    )


def _boot() -> str:
    """Return what names this boot of this host, or at least the host where no system tells.

    Linux has a file, macOS a variable of its kernel.
    """
    if BOOT.exists():
        return BOOT.read_text().strip()
    ask = ["sysctl", "-n", "kern.bootsessionuuid"]
    try:
        return subprocess.run(ask, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return f"{uuid.getnode():x}-{platform.system()}"


class HostClock:
    """The monotonic clock that all processes of one boot of this host share.

    Containers may have a time namespace, whose monotonic clock is another.
    """

    def __init__(self) -> None:
        self._id = f"boot-{_boot()}"
        inode = TIME_NAMESPACE.stat().st_ino if TIME_NAMESPACE.exists() else INITIAL_TIME_NAMESPACE
        if inode != INITIAL_TIME_NAMESPACE:
            self._id += f"-{inode}"

    @property
    def id(self) -> str:
        """Identity of the clock: changes when the host boots."""
        return self._id

    def now_ns(self) -> int:
        """Monotonic nanoseconds."""
        return time.monotonic_ns()
