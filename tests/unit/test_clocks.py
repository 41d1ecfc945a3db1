"""Ages and replays: what cannot be known is stale, what is not newer is a replay."""

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


def test_replays_are_refused() -> None:
    gate = ReplayGate()
    assert [gate.accept(*x) for x in ((1, 1), (1, 1), (1, 3), (1, 2))] == [True, False, True, False]
    assert gate.accept(2, 0)
    assert not gate.accept(1, 100)
