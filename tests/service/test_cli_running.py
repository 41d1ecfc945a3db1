"""What status, up and events make of what they hear."""

import time
from pathlib import Path

import pytest

from fakes import FakeBus
from juncnet.clocks import Instant
from juncnet.flight import Flight
from juncnet.messages import EventKind, Health, JunctionEvent, RemoteClock
from juncnet.topics import JUNCTION_EVENT, health_topic
from juncnet_services.cli.events import CAPACITY, Once, follow, line
from juncnet_services.cli.status import FRESH_S, FlightStatus, links, rows
from juncnet_services.cli.supervise import ProcessStatus, Supervisor
from juncnet_services.cli.up import MAX_RESTARTS, Waited, failure_text, hopeless, listen
from scenes import stamp


def health(service: str, second: float) -> Health:
    return Health(service=service, at=stamp(second), flight="f", pid=1, rate_hz=25.0)


def event(index: int, flight: str = "f") -> JunctionEvent:
    return JunctionEvent(
        header=stamp(1.0),
        flight=flight,
        index=index,
        kind=EventKind.APPROACHED,
        count=1,
        probability=0.9,
    )


def test_a_process_is_well_when_it_runs_and_has_reported_of_late() -> None:
    now = Instant(round(100e9), "fake-clock")
    statuses = [ProcessStatus(name, "RUNNING", 7, 5.0) for name in ("a", "b", "c")]
    statuses.append(ProcessStatus("d", "BACKOFF", 0, 0.0))
    healths = {"a": health("a", 99.5), "b": health("b", 99.9 - FRESH_S), "d": health("d", 99.9)}
    found = rows(("a", "b", "c", "d", "e"), statuses, {"a": 2}, healths, now)
    assert [row.process for row in found] == ["a", "b", "c", "d", "e"]
    assert [row.well for row in found] == [True, False, False, False, False]
    assert [row.state for row in found] == ["running"] * 3 + ["backoff", "unknown"]
    assert [row.restarts for row in found] == [2, 0, 0, 0, 0]


def test_clocks_of_other_hosts_are_shown_with_their_uncertainty() -> None:
    known = RemoteClock(offset_ns=5_000_123_456_789, uncertainty_ns=1_500_000)
    report = health("a", 99.5).model_copy(
        update={"clocks": {"boot-far": known, "boot-gone": RemoteClock()}, "linked": False}
    )
    now = Instant(round(100e9), "fake-clock")
    found = rows(("a",), [ProcessStatus("a", "RUNNING", 7, 5.0)], {}, {"a": report}, now)
    status = FlightStatus(flight="f", directory="/d", robot="r", well=True, processes=found)
    assert links(status) == [
        " a: the vehicle's router is not reached",
        " a: clock boot-far is +5000.1235 s ahead of this host's, within 1.50 ms",
        " a: clock boot-gone has an unknown offset: what it stamps counts as stale",
    ]


def test_waiting_is_hopeless_for_what_has_ended_or_ends_again_and_again() -> None:
    statuses = [
        ProcessStatus("ended", "EXITED", 0, 0.0),
        ProcessStatus("again", "BACKOFF", 0, 0.0),
        ProcessStatus("slow", "RUNNING", 3, 1.0),
        ProcessStatus("heard", "EXITED", 0, 0.0),
    ]
    restarts = {"again": MAX_RESTARTS, "slow": MAX_RESTARTS - 1}
    assert hopeless(["ended", "again", "slow"], statuses, restarts) == ["ended", "again"]


class Supervised(Supervisor):
    """A supervisor of processes in these states."""

    def __init__(self, **states: str) -> None:
        super().__init__(Path("nowhere"))
        self.states = states

    def status(self) -> list[ProcessStatus]:
        return [ProcessStatus(name, state, 1, 1.0) for name, state in self.states.items()]


@pytest.mark.parametrize(
    ("ended", "waited"),
    [("EXITED", Waited(("b",), ("c",))), ("RUNNING", Waited((), ("b", "c")))],
)
def test_nobody_is_waited_for_once_a_process_will_not_work(ended: str, waited: Waited) -> None:
    flight = Flight("f", Path("nowhere"), "r", ("a", "b", "c"))
    supervisor = Supervised(a="RUNNING", b="RUNNING", c="RUNNING")

    def end(_: FakeBus) -> None:
        supervisor.states["b"] = ended

    bus = FakeBus([(health_topic("a"), health("a", 1.0)), 0.2, 0.2, end, *[0.2] * 50])
    assert listen(bus, flight, supervisor, time.monotonic() + 60.0) == waited
    assert bus.running is (ended == "EXITED")
    said = failure_text(flight, supervisor, waited)
    assert ("1 of 3 processes will not work" in said) is (ended == "EXITED")
    assert "b (" + ended.lower() in said
    assert ("any longer: c" in said) is (ended == "EXITED")


def test_every_event_passes_once() -> None:
    once = Once()
    first = [("r", event(0)), ("r", event(1)), ("r", event(0))]
    assert once.news(first) == first[:2]
    assert once.news([("r", event(1)), ("r", event(2))]) == [("r", event(2))]
    others = [("other", event(0)), ("r", event(0, "g"))]
    assert once.news(others) == others


def test_events_are_printed_as_they_come(capsys: pytest.CaptureFixture[str]) -> None:
    events = [event(0), event(1), event(1)]
    bus = FakeBus([(JUNCTION_EVENT, item) for item in events])
    follow(bus, bus.subscribe(JUNCTION_EVENT, CAPACITY), True, None, float("inf"))
    printed = capsys.readouterr().out.splitlines()
    assert printed == [line("robot", item, True) for item in events[:2]]
    assert all('"robot": "robot"' in text for text in printed)
