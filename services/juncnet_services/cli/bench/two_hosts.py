"""Two hosts on this machine for tests: drone and laptop, an access point between them.

Three network namespaces. The access point forwards and has a queue at either side, so a slow link
and an outage look as over WiFi: nobody is told, packets are late or gone. The laptop has a time
namespace as well, so its monotonic clock is another one, by a difference that is known exactly.
"""

import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import IO

DRONE, AP, LAPTOP = "drone", "ap", "laptop"
ADDRESS = {DRONE: "10.203.1.2", LAPTOP: "10.203.2.2"}
GATEWAY = {DRONE: "10.203.1.1", LAPTOP: "10.203.2.1"}
CLOCK_AHEAD_S = 5000
"""How far the laptop's clock runs ahead of the drone's."""
QUEUE_S = 0.1
"""What the access point's queues hold at most: a cheap one's."""
BURST_BYTES = 20_000
DELAY_TABLE = "100"
"""Routes of packets that are to be held back."""


def why_not() -> str | None:
    """Return why hosts cannot be made here; None: they can."""
    if sys.platform != "linux":
        return "network namespaces are Linux's"
    if os.geteuid() != 0:
        return "only root may make network namespaces"
    missing = [tool for tool in ("ip", "tc", "unshare") if shutil.which(tool) is None]
    if missing:
        return f"not installed: {', '.join(missing)} (packages iproute2 and util-linux)"
    name = f"jn-try-{os.getpid()}"
    tried = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True)
    if tried.returncode == 0:
        tried = subprocess.run(
            [
                "ip",
                "netns",
                "exec",
                name,
                "unshare",
                "--time",
                "--monotonic",
                "1",
                "--fork",
                "true",
            ],
            capture_output=True,
            text=True,
        )
        subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)
    return tried.stderr.strip() or None if tried.returncode else None


class TwoHosts:
    """The namespaces, as a context; what still runs in them at its end is killed."""

    def __init__(self) -> None:
        self._names = {host: f"jn{os.getpid()}-{host}" for host in (DRONE, AP, LAPTOP)}

    def __enter__(self) -> "TwoHosts":
        try:
            self._make()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for host, name in self._names.items():
            for pid in self.pids(host):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, 9)
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)

    def start(
        self,
        host: str,
        command: Sequence[str],
        environment: Mapping[str, str],
        log: IO[bytes] | int = subprocess.DEVNULL,
    ) -> subprocess.Popen[bytes]:
        """Start `command` on a host; the laptop's has its own clock."""
        clock = ["unshare", "--time", "--monotonic", str(CLOCK_AHEAD_S), "--fork", "--kill-child"]
        return subprocess.Popen(
            [
                "ip",
                "netns",
                "exec",
                self._names[host],
                *(clock if host == LAPTOP else []),
                *command,
            ],
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )

    def pids(self, host: str) -> list[int]:
        """Return the processes that run on a host."""
        found = subprocess.run(
            ["ip", "netns", "pids", self._names[host]], capture_output=True, text=True, check=False
        )
        return [int(pid) for pid in found.stdout.split()]

    def shape(self, bits_per_s: int) -> None:
        """Give the link this rate, in either direction."""
        for device in ("to-drone", "to-laptop"):
            rate = ["rate", str(bits_per_s), "burst", str(BURST_BYTES), "latency", f"{QUEUE_S}s"]
            self._in(AP, "tc", "qdisc", "replace", "dev", device, "root", "tbf", *rate)

    @contextlib.contextmanager
    def delay(self, seconds: float) -> Generator[None]:
        """Hold every packet back for so long, in either direction, while the context lasts."""
        self._in(AP, "ip", "tuntap", "add", "slow", "mode", "tun")
        self._in(AP, "ip", "link", "set", "slow", "up")
        self._in(AP, "ip", "route", "add", "default", "dev", "slow", "table", DELAY_TABLE)
        for device in ("to-drone", "to-laptop"):
            self._in(AP, "ip", "rule", "add", "iif", device, "lookup", DELAY_TABLE)
        module = (sys.executable, "-m", "juncnet_services.cli.bench.delay_line")
        line = self.start(AP, [*module, "slow", str(seconds)], {})
        try:
            yield
        finally:
            line.kill()
            line.wait()
            for _ in ("to-drone", "to-laptop"):
                self._in(AP, "ip", "rule", "del", "lookup", DELAY_TABLE)
            self._in(AP, "ip", "link", "del", "slow")

    @contextlib.contextmanager
    def outage(self) -> Generator[None]:
        """Let no packet through while the context lasts; nobody is told."""
        self._forward(False)
        try:
            yield
        finally:
            self._forward(True)

    def _make(self) -> None:
        for name in self._names.values():
            subprocess.run(["ip", "netns", "add", name], check=True)
        for host in (DRONE, LAPTOP):
            ap_end = f"to-{host}"
            self._in(AP, "ip", "link", "add", ap_end, "type", "veth", "peer", "name", "wlan",
                     "netns", self._names[host])  # fmt: skip
            self._in(AP, "ip", "address", "add", f"{GATEWAY[host]}/24", "dev", ap_end)
            self._in(AP, "ip", "link", "set", ap_end, "up")
            self._in(host, "ip", "address", "add", f"{ADDRESS[host]}/24", "dev", "wlan")
            self._in(host, "ip", "link", "set", "wlan", "up")
            self._in(host, "ip", "link", "set", "lo", "up")
            self._in(host, "ip", "route", "add", "default", "via", GATEWAY[host])
        self._forward(True)

    def _forward(self, on: bool) -> None:
        text = f"echo {int(on)} > /proc/sys/net/ipv4/ip_forward"
        self._in(AP, "sh", "-c", text)

    def _in(self, host: str, *command: str) -> None:
        subprocess.run(["ip", "netns", "exec", self._names[host], *command], check=True)


def wait_for(path: Path, limit_s: float) -> bool:
    """Wait until a file is there; return whether it is."""
    deadline = time.monotonic() + limit_s
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    return path.exists()
