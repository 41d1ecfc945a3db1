"""Clocks of other hosts, asked for over Zenoh: who answers, who asks, and how often.

Every process tells the time of its host's clock to whoever asks for that clock.
"""

import threading
from functools import partial

import zenoh

from juncnet.clock_offset import Exchange, Offsets
from juncnet.clocks import Clock
from juncnet.messages import ClockReading, MessageError
from juncnet.topics import clock_key
from juncnet.zenoh_remote import RemoteSession

ANSWER_S = 1.0
"""Later answers say nothing: their bounds are too wide."""
TICK_S = 0.05
END_S = 5.0
"""A thread that is killed in the middle of a call would take the process with it."""
IDLE_TICK_S = 0.5
"""While no other clock is wanted."""


def tell_time(session: zenoh.Session, clock: Clock) -> zenoh.Queryable[None]:
    """Answer whoever asks for `clock` on this session, at once, in a thread of Zenoh's.

    Every robot may ask, under its own name: a dashboard orders robots that it hears of later.
    """
    key = clock_key("*", clock.id)

    def answer(query: zenoh.Query) -> None:
        reading = ClockReading(clock=clock.id, time_ns=clock.now_ns())
        # Zenoh leaves the results of its commands without a type.
        query.reply(  # pyright: ignore[reportUnknownMemberType]
            query.key_expr, reading.encode()[0], encoding=ClockReading.encoding(), express=True
        )

    return session.declare_queryable(key, answer)


class ClockWatch:
    """Keeps `offsets` measured, in a thread of its own.

    Asks on `here`, a session of this host, or through the vehicle's router where there is one.
    """

    def __init__(
        self,
        offsets: Offsets,
        clock: Clock,
        robot: str,
        here: zenoh.Session,
        remote: RemoteSession | None,
    ) -> None:
        self._offsets, self._clock, self._robot = offsets, clock, robot
        self._here, self._remote = here, remote
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="clocks", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._closing.set()
        self._thread.join(END_S)

    def _run(self) -> None:
        while not self._closing.wait(TICK_S if self._offsets.wanted() else IDLE_TICK_S):
            session = self._here if self._remote is None else self._remote.session
            if session is None:
                continue
            for clock in self._offsets.due():
                self._ask(session, clock)

    def _ask(self, session: zenoh.Session, clock: str) -> None:
        asked_ns = self._clock.now_ns()
        session.get(
            clock_key(self._robot, clock),
            partial(self._hear, clock, asked_ns),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            priority=zenoh.Priority.REAL_TIME,
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
            timeout=ANSWER_S,
        )

    def _hear(self, clock: str, asked_ns: int, reply: zenoh.Reply) -> None:
        answered_ns = self._clock.now_ns()
        if reply.ok is None:
            return
        try:
            reading = ClockReading.decode(reply.ok.payload.to_bytes())
        except MessageError:
            return
        if reading.clock == clock:
            self._offsets.heard(clock, Exchange(asked_ns, reading.time_ns, answered_ns))
