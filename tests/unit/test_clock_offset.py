"""Offsets of other hosts' clocks: bounds that hold whatever the link does."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes import FakeClock
from juncnet.clock_offset import (
    DRIFT,
    MAX_CLOCKS,
    PERIOD_S,
    WANTED_S,
    WINDOW_S,
    Exchange,
    OffsetEstimate,
    Offsets,
)
from juncnet.clocks import Instant, age_s, is_stale

MS = 1_000_000
S = 1_000_000_000
ROUNDING_NS = 3


def exchange(at_ns: int, offset_ns: int, there_ns: int, back_ns: int) -> Exchange:
    """A question that leaves at `at_ns` and takes so long there and back."""
    return Exchange(at_ns, at_ns + there_ns + offset_ns, at_ns + there_ns + back_ns)


def test_an_equal_way_there_and_back_gives_the_offset_exactly() -> None:
    estimate = OffsetEstimate()
    estimate.add(exchange(0, 7 * S, 3 * MS, 3 * MS))
    offset = estimate.at(6 * MS)
    assert offset is not None
    assert offset.offset_ns == 7 * S
    assert offset.uncertainty_ns == 3 * MS + DRIFT * 6 * MS


def test_the_quick_way_of_each_direction_counts_though_no_exchange_was_quick() -> None:
    estimate = OffsetEstimate()
    estimate.add(exchange(0, 0, 1 * MS, 80 * MS))
    estimate.add(exchange(100 * MS, 0, 80 * MS, 1 * MS))
    offset = estimate.at(181 * MS)
    assert offset is not None
    assert offset.uncertainty_ns < 1.1 * MS
    assert abs(offset.offset_ns) < 0.1 * MS


def test_uncertainty_grows_until_the_offset_is_unknown() -> None:
    estimate = OffsetEstimate()
    estimate.add(exchange(0, 5 * S, MS, MS))
    early, late = estimate.at(2 * MS), estimate.at(5 * S)
    assert early is not None
    assert late is not None
    assert late.uncertainty_ns - early.uncertainty_ns == pytest.approx(DRIFT * 5 * S, rel=0.01)
    assert estimate.at(round((WINDOW_S + 1) * S)) is None


def test_a_clock_that_jumps_is_believed_at_once() -> None:
    estimate = OffsetEstimate()
    for second in range(5):
        estimate.add(exchange(second * S, 9 * S, MS, MS))
    estimate.add(exchange(5 * S, 4 * S, MS, MS))
    offset = estimate.at(5 * S + 2 * MS)
    assert offset is not None
    assert abs(offset.offset_ns - 4 * S) <= offset.uncertainty_ns <= 2 * MS


def test_an_answer_before_its_question_is_ignored() -> None:
    estimate = OffsetEstimate()
    estimate.add(Exchange(10, 5, 9))
    assert estimate.at(10) is None


delays = st.integers(0, 2 * S)


@given(
    st.integers(-(10**15), 10**15),
    st.lists(st.tuples(st.integers(0, S), delays, delays), min_size=1, max_size=20),
    st.floats(-0.9, 0.9),
)
def test_the_true_offset_is_within_the_uncertainty(
    start_ns: int, ways: list[tuple[int, int, int]], drift: float
) -> None:
    estimate, now_ns = OffsetEstimate(), 0

    def truth(at_ns: int) -> int:
        return start_ns + round(drift * DRIFT * at_ns)

    for pause_ns, there_ns, back_ns in ways:
        asked_ns = now_ns + pause_ns
        there = asked_ns + there_ns
        now_ns = there + back_ns
        estimate.add(Exchange(asked_ns, there + truth(there), now_ns))
        offset = estimate.at(now_ns)
        assert offset is not None
        assert abs(offset.offset_ns - truth(now_ns)) <= offset.uncertainty_ns + ROUNDING_NS


def test_a_wanted_clock_is_due_until_known_and_then_from_time_to_time() -> None:
    clock = FakeClock()
    offsets = Offsets(clock)
    assert offsets.due() == []
    assert offsets.get("far") is None
    assert offsets.due() == ["far"]
    assert offsets.due() == []
    offsets.heard("far", exchange(clock.ns, 3 * S, MS, MS))
    assert offsets["far"].offset_ns == 3 * S
    assert list(offsets) == ["far"]
    clock.advance(PERIOD_S / 2)
    assert offsets.due() == []
    clock.advance(PERIOD_S / 2)
    assert offsets.due() == ["far"]
    clock.advance(WANTED_S + 1)
    assert offsets.due() == []
    assert offsets.wanted() == {}


def test_our_own_clock_needs_no_measurement() -> None:
    clock = FakeClock()
    offsets = Offsets(clock)
    assert offsets[clock.id].uncertainty_ns == 0
    assert offsets.due() == []


def test_answers_about_unwanted_clocks_are_ignored_and_the_table_is_bounded() -> None:
    offsets = Offsets(FakeClock())
    offsets.heard("stranger", exchange(0, 0, 1, 1))
    assert "stranger" not in offsets.wanted()
    for number in range(3 * MAX_CLOCKS):
        assert offsets.get(f"clock-{number}") is None
    assert len(offsets.wanted()) == MAX_CLOCKS


def test_without_an_offset_everything_of_another_clock_is_stale() -> None:
    clock = FakeClock()
    offsets = Offsets(clock)
    then, now = Instant(clock.ns + 3 * S, "far"), Instant(clock.ns, clock.id)
    assert is_stale(age_s(then, now, offsets.get("far")), 0.2)
    offsets.heard("far", exchange(clock.ns - 2 * MS, 3 * S, MS, MS))
    age = age_s(then, now, offsets.get("far"))
    assert age is not None
    assert 0 <= age < 0.002
