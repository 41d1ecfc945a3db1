"""Bytes on keys of a Zenoh network that is not a flight's: ROS 2's, for instance.

Nothing of juncnet's topics and messages goes over it; a Bus is for those.
"""

import contextlib
import json
from collections.abc import Callable
from typing import Any

import zenoh

from juncnet import links


class RawSession:
    """A session with the router at `endpoint` (`tcp/host:7447`); links, and links anew, by itself.

    Raises:
        ValueError: `endpoint` is none.
    """

    def __init__(self, endpoint: str) -> None:
        try:
            config = zenoh.Config.from_json5(json.dumps(links.foreign(endpoint)))
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise ValueError(f"endpoint {endpoint}: {error}") from error
        self._declared: list[Any] = []

    @property
    def id(self) -> str:
        """The session's id in its network, in hexadecimal."""
        return str(self._session.info.zid())

    @property
    def linked(self) -> bool:
        """Whether the router is reached now."""
        return bool(self._session.info.routers_zid() or self._session.info.peers_zid())

    def show(self, key: str) -> None:
        """Declare a liveliness token: others see `key` for as long as this session is linked."""
        self._declared.append(self._session.liveliness().declare_token(key))

    def publisher(self, key: str) -> Callable[[bytes, bytes | None], None]:
        """Return what publishes a payload, with an attachment or without, and never blocks."""
        publisher: Any = self._session.declare_publisher(
            key,
            priority=zenoh.Priority.REAL_TIME,
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )
        self._declared.append(publisher)

        def put(payload: bytes, attachment: bytes | None) -> None:
            publisher.put(payload, attachment=attachment)

        return put

    def close(self) -> None:
        """Leave the network."""
        for declared in self._declared:
            with contextlib.suppress(zenoh.ZError):
                declared.undeclare()
        with contextlib.suppress(zenoh.ZError):
            self._session.close()  # pyright: ignore[reportUnknownMemberType]
