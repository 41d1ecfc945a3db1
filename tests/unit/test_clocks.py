"""Ages and replays: what cannot be known is stale, what is not newer is a replay."""

from dataclasses import dataclass

import pytest

from juncnet.clocks import Instant, Offset, ReplayGate, age_s, is_stale

S = 1_000_000_000


def test_age_on_one_clock() -> None:
    assert age_s(Instant(S, "a"), Instant(3 * S, "a")) == 2.0


def test_uncertainties_err_towards_old() -> None:
    then, now = Instant(S, "a", uncertainty_ns=S // 10), Instant(2 * S, "a", S // 10)
    assert age_s(then, now) == pytest.approx(1.2)
    offset = Offset(10 * S, S // 2)
    assert age_s(Instant(11 * S, "b"), Instant(2 * S, "a"), offset) == pytest.approx(1.5)


def test_unknown_ages() -> None:
    assert age_s(Instant(S, "b"), Instant(2 * S, "a")) is None
    assert age_s(Instant(3 * S, "a"), Instant(2 * S, "a")) is None
    assert age_s(Instant(3 * S, "a", 2 * S), Instant(2 * S, "a")) == 1.0


def test_staleness() -> None:
    assert is_stale(None, 0.2)
    assert is_stale(0.21, 0.2)
    assert not is_stale(0.2, 0.2)


@dataclass(frozen=True)
class Sent:
    """The `sequence` of process `epoch`, sent at `at_s` on `clock`."""

    epoch: int
    sequence: int
    at_s: float
    clock: str = "a"

    @property
    def instant(self) -> Instant:
        return Instant(round(self.at_s * S), self.clock)


NOW = Instant(100 * S, "a")


def passed(gate: ReplayGate, *sent: Sent) -> list[bool]:
    return [gate.accept(one, NOW) for one in sent]


def test_replays_are_refused() -> None:
    sent = [Sent(1, sequence, 1 + sequence) for sequence in (1, 1, 3, 2)]
    assert passed(ReplayGate(), *sent) == [True, False, True, False]


def test_a_restarted_sender_passes_at_once_and_its_predecessor_no_more() -> None:
    gate = ReplayGate()
    assert passed(gate, Sent(5, 900, 10), Sent(6, 1, 10.001)) == [True, True]
    assert not any(passed(gate, Sent(6, 1, 10.001), Sent(5, 900, 10), Sent(5, 901, 12)))
    assert passed(gate, Sent(6, 2, 10.04)) == [True]


def test_another_clock_takes_over_by_measured_time_and_by_no_other() -> None:
    gate, offset = ReplayGate(), Offset(1000 * S, S // 1000)
    other = Sent(1, 1, 1011, "b")
    assert gate.accept(Sent(1, 5, 10), NOW)
    assert not gate.accept(other, NOW)
    assert not gate.accept(other, NOW, Offset(1002 * S, 0))
    assert not gate.accept(Sent(1, 1, 5000, "b"), NOW, offset)
    assert gate.accept(other, NOW, offset)
    assert gate.accept(Sent(1, 2, 1012, "b"), NOW, offset)


def test_from_a_clock_that_was_taken_over_from_only_a_process_started_since_passes() -> None:
    gate, offset = ReplayGate(), Offset(1000 * S, 0)
    assert gate.accept(Sent(1, 5, 10), NOW)
    assert gate.accept(Sent(7, 1, 1011, "b"), NOW, offset)
    assert passed(gate, Sent(1, 6, 12), Sent(2, 1, 10.5), Sent(2, 2, 12)) == [False, False, True]
    assert not gate.accept(Sent(7, 2, 1013, "b"), NOW, offset)


def test_what_comes_from_the_future_keeps_no_other_clock_out() -> None:
    gate, offset = ReplayGate(), Offset(1000 * S, 0)
    assert passed(gate, Sent(1, 1, 5000)) == [True]
    assert gate.accept(Sent(1, 1, 1010, "b"), NOW, offset)
