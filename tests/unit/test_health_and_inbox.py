"""What waits, what gave way, and what a process counts about itself."""

import threading
import time

import pytest

from fakes import FakeClock
from juncnet.health import HealthCounters, percentile
from juncnet.inbox import Mailbox, Wake
from juncnet.messages import LoadModel, Stamp


def message(name: str) -> LoadModel:
    return LoadModel(path=name)


def test_percentile_is_the_nearest_rank() -> None:
    values = [float(i) for i in range(1, 101)]
    assert [percentile(values, f) for f in (0.0, 0.5, 0.99, 1.0)] == [1.0, 50.0, 99.0, 100.0]


def test_health_reports_rate_age_latency_and_starts_anew() -> None:
    clock = FakeClock()
    health = HealthCounters("alpha", clock)
    header = Stamp(epoch=1, sequence=1, time_ns=clock.now_ns(), clock=clock.id)
    for _ in range(10):
        clock.advance(0.1)
        health.output(clock.now_ns() - 2_000_000, header)
    health.add("lost")
    health.add("lost", 2)
    health.error("first")
    health.error("second")
    report = health.report(header, "f1", 42, drops=3)
    assert report.rate_hz == pytest.approx(10.0)
    assert report.age_s == pytest.approx(1.0)
    assert (report.latency_p50_ms, report.latency_p99_ms) == (2.0, 2.0)
    assert (report.errors, report.last_error, report.drops) == (2, "second", 3)
    assert report.counters == {"lost": 3.0}
    clock.advance(1.0)
    empty = health.report(header, "f1", 42, drops=3)
    assert (empty.rate_hz, empty.age_s, empty.latency_p50_ms) == (0.0, None, None)
    assert (empty.errors, empty.counters) == (2, {"lost": 3.0})


def test_errors_are_logged_once_a_second(caplog: pytest.LogCaptureFixture) -> None:
    clock = FakeClock()
    health = HealthCounters("alpha", clock)
    for _ in range(50):
        health.error("bad")
    clock.advance(1.1)
    health.error("bad")
    assert [r.message for r in caplog.records] == ["bad", "bad (and 49 more errors)"]


def test_an_error_that_names_a_file_in_no_encoding_can_be_told() -> None:
    clock = FakeClock()
    health = HealthCounters("alpha", clock)
    health.error("caf\udce9.png: no readable picture")
    at = Stamp(epoch=1, sequence=1, time_ns=clock.now_ns(), clock=clock.id)
    report = health.report(at, "f1", 42, drops=0)
    report.encode()
    assert report.last_error == "caf?.png: no readable picture"


def test_the_oldest_gives_way_and_is_counted() -> None:
    inbox = Mailbox[LoadModel](Wake(), 2)
    for name in "abcd":
        inbox.put("robot", message(name))
    assert inbox.newest == message("d")
    assert [inbox.take(), inbox.take(), inbox.take()] == [message("c"), message("d"), None]
    assert inbox.drops == 2
    assert inbox.newest == message("d")


def test_capacity_is_per_robot() -> None:
    inbox = Mailbox[LoadModel](Wake(), 1)
    for name, robot in (("a", "one"), ("b", "two"), ("c", "one")):
        inbox.put(robot, message(name))
    assert inbox.drain() == [("two", message("b")), ("one", message("c"))]
    inbox.put("one", message("d"))
    assert inbox.drops == 1
    with pytest.raises(ValueError, match="capacity"):
        Mailbox[LoadModel](Wake(), 0)


def test_taking_waits_for_another_thread_and_ends_at_shutdown() -> None:
    wake = Wake()
    inbox = Mailbox[LoadModel](wake, 1)
    assert inbox.take(0.01) is None
    threading.Timer(0.05, inbox.put, ("robot", message("a"))).start()
    assert inbox.take(5.0) == message("a")
    threading.Timer(0.05, wake.stop).start()
    started = time.monotonic()
    assert list(inbox) == []
    assert time.monotonic() - started < 0.9
    assert not wake.running


class Counted(threading.Condition):
    """Counts how often all who wait are woken."""

    woken = 0

    def notify_all(self) -> None:
        self.woken += 1
        super().notify_all()


@pytest.mark.parametrize("wakes", [True, False])
def test_a_quiet_inbox_wakes_only_who_takes_from_it(wakes: bool) -> None:
    wake = Wake()
    wake.condition = condition = Counted(threading.RLock())
    inbox = Mailbox[LoadModel](wake, 4, wakes)
    inbox.put("robot", message("a"))
    assert condition.woken == wakes
    assert inbox.take() == message("a")
    threading.Timer(0.05, inbox.put, ("robot", message("b"))).start()
    assert inbox.take(30.0) == message("b")
    assert condition.woken == wakes + 1
    inbox.put("robot", message("c"))
    assert condition.woken == 2 * wakes + 1


def test_sleep_lasts_whatever_arrives_and_ends_at_shutdown() -> None:
    wake = Wake()
    inbox = Mailbox[LoadModel](wake, 4)
    threading.Timer(0.05, inbox.put, ("robot", message("a"))).start()
    began = time.monotonic()
    assert wake.sleep(0.2)
    assert time.monotonic() - began >= 0.2
    assert inbox.ready
    threading.Timer(0.05, wake.stop).start()
    assert not wake.sleep(30.0)
    assert not wake.sleep(30.0)
    assert time.monotonic() - began < 20
