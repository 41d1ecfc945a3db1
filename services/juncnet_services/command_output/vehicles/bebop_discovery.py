"""Where a Bebop 2 is, by mDNS. Needs the extra [bebop]; a drone's plain address needs nothing."""

import importlib.util
import time
from queue import Empty, Queue
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from zeroconf import Zeroconf

SERVICE = "_arsdk-090c._udp.local."
"""What a Bebop 2 announces, with the TCP port of its own discovery."""
OTHERS_S = 0.5
"""After the first answer so long is waited for those of other drones."""


def is_installed() -> bool:
    """Return whether drones can be looked for here."""
    return importlib.util.find_spec("zeroconf") is not None


def find(limit_s: float) -> tuple[str, int]:
    """Return (address, port of discovery) of the only Bebop 2 in this host's networks.

    Raises:
        ConnectionError: there is none within `limit_s`, or more than one.
        ImportError: zeroconf is not installed.
    """
    from zeroconf import InterfaceChoice, IPVersion, ServiceBrowser, Zeroconf

    names: Queue[str] = Queue()

    def changed(zeroconf: "Zeroconf", service_type: str, name: str, state_change: object) -> None:
        del zeroconf, service_type, state_change
        names.put(name)

    with Zeroconf(interfaces=InterfaceChoice.All, ip_version=IPVersion.V4Only) as network:
        browser = ServiceBrowser(network, SERVICE, handlers=[changed])
        try:
            found = {name: _place(network, name) for name in _heard(names, limit_s)}
        finally:
            browser.cancel()
    places = {name: place for name, place in found.items() if place is not None}
    if not places:
        raise ConnectionError(
            "no Bebop announces itself: is it on, and is this host in its WiFi? Else name its "
            "address, 192.168.42.1 in its own network"
        )
    if len(places) > 1:
        seen = ", ".join(f"{n.partition('.')[0]} at {a}" for n, (a, _) in sorted(places.items()))
        raise ConnectionError(f"several Bebops: {seen}; name the address of yours")
    return next(iter(places.values()))


def _heard(names: "Queue[str]", limit_s: float) -> set[str]:
    """Return the names heard until `OTHERS_S` after the first, `limit_s` at most."""
    heard: set[str] = set()
    ends_s = time.monotonic() + limit_s
    while (left_s := ends_s - time.monotonic()) > 0:
        try:
            heard.add(names.get(timeout=left_s))
        except Empty:
            break
        if len(heard) == 1:
            ends_s = min(ends_s, time.monotonic() + OTHERS_S)
    return heard


def _place(network: "Zeroconf", name: str) -> tuple[str, int] | None:
    """Return (address, port) of a drone that was heard; None when it does not say."""
    from zeroconf import IPVersion

    info = network.get_service_info(SERVICE, name, timeout=1000)
    if info is None or not info.port:
        return None
    addresses = info.parsed_addresses(IPVersion.V4Only)
    return (addresses[0], info.port) if addresses else None
