"""Drone and laptop as two hosts with clocks of their own: overload, outage, a vanished host."""

import time
from collections.abc import Iterator

import pytest

from flights import StallWatch, flights_folder
from juncnet.clocks import MAX_COMMAND_AGE_S, NS_PER_S
from juncnet.messages import Output
from juncnet.topics import VEHICLE_STATE
from juncnet_services.cli.bench.split import Figures, clock_figures, obeyed_ages_ms, outage_figures
from juncnet_services.cli.bench.split_flight import SplitFlight, log_tails
from juncnet_services.cli.bench.two_hosts import LAPTOP, TwoHosts, why_not
from juncnet_services.cli.demo import prepare

pytestmark = pytest.mark.full
LINK_BITS_PER_S = 40_000_000
SIZE = (640, 360)
VIDEO_BITS_PER_S = 4_000_000
FORGOTTEN_S = 12.0
"""After so long the quick exchanges of before no longer tell a host's clock."""


@pytest.fixture(name="hosts", scope="module")
def _hosts() -> Iterator[TwoHosts]:
    reason = why_not()
    if reason is not None:
        pytest.skip(f"no network namespaces here: {reason}")
    with TwoHosts() as hosts:
        hosts.shape(LINK_BITS_PER_S)
        yield hosts


@pytest.fixture(name="flight")
def _flight(hosts: TwoHosts, monkeypatch: pytest.MonkeyPatch) -> Iterator[SplitFlight]:
    with flights_folder(monkeypatch) as folder:
        setup = prepare("copter", None, 24)
        try:
            with SplitFlight(hosts, folder, setup, SIZE, VIDEO_BITS_PER_S) as flight:
                assert flight.until_moving(120), "the robot does not move"
                yield flight
        except BaseException:
            print(log_tails(folder))
            raise


def known_clock(flight: SplitFlight) -> Figures:
    """Return the figures of the clock once the vehicle's health has told them, every second."""
    deadline = time.monotonic() + 10
    while "error" in (clock := clock_figures(flight)) and time.monotonic() < deadline:
        flight.listen(0.2)
    return clock


def test_overload_and_an_outage_of_three_seconds(hosts: TwoHosts, flight: SplitFlight) -> None:
    clock = known_clock(flight)
    assert abs(clock["error_ms"]) <= clock["uncertainty_ms"] < 50
    with StallWatch() as watch:
        first, began_ns = len(flight.ears.commands), time.monotonic_ns()
        with flight.overload(round(1.5 * LINK_BITS_PER_S)):
            flight.listen(10.0)
        ages = sorted(command.age_ms for command in flight.ears.commands[first:])
        assert len(ages) > 50, "commands do not pass"
        if not watch.stalled(began_ns, time.monotonic_ns()):
            assert ages[int(0.99 * len(ages))] < 60
        outage = outage_figures(flight, hosts, 3.0)
        assert "error" not in outage, outage
        assert outage["moves_again_after_s"] is not None, "the mission did not go on"
        obeyed = obeyed_ages_ms(flight.tap.told, flight.ears.commands)
        if not watch.stalled(began_ns, time.monotonic_ns()):
            assert outage["hold_after_last_issue_s"] <= MAX_COMMAND_AGE_S
            assert max(obeyed) <= 1e3 * MAX_COMMAND_AGE_S
    assert flight.ears.judge.summary().off_road_max_m < 0.5


def test_a_laptop_that_vanishes_leaves_the_robot_holding_for_good(
    hosts: TwoHosts, flight: SplitFlight
) -> None:
    states = flight.ears.bus.subscribe(VEHICLE_STATE, 1000)
    with StallWatch() as watch:
        with hosts.outage():  # no process gets to say goodbye
            gone_ns = time.monotonic_ns()
            flight.kill(LAPTOP)
            flight.listen(0.5)
        hold = next(told for told in flight.tap.told if told.holds and told.ns > gone_ns)
        last_ns = max(c.issued_ns for c in flight.ears.commands if c.arrived_ns < hold.ns)
        if not watch.stalled(gone_ns, hold.ns):
            assert hold.ns - last_ns <= MAX_COMMAND_AGE_S * NS_PER_S
    flight.listen(6.0)
    assert all(told.holds for told in flight.tap.told if told.ns > hold.ns)
    newest = states.newest
    assert newest is not None
    assert newest.output is Output.STOPPED
    assert "operator" in newest.output_reason


def test_with_100_ms_there_and_back_the_robot_moves_and_with_100_each_way_it_holds(
    hosts: TwoHosts, flight: SplitFlight
) -> None:
    with hosts.delay(0.05):
        flight.listen(FORGOTTEN_S)
        first = len(flight.ears.commands)
        assert flight.until_moving(), "the robot does not move"
        flight.listen(5.0)
        clock = known_clock(flight)
        assert abs(clock["error_ms"]) <= clock["uncertainty_ms"]
        assert clock["uncertainty_ms"] > 49
        ages = sorted(command.age_ms for command in flight.ears.commands[first:])
        assert ages[0] > 49
    with hosts.delay(0.1):  # no age is known better than half of there and back: 0.2 s at most
        flight.listen(FORGOTTEN_S)
        first = len(flight.tap.told)
        flight.listen(3.0)
        assert len(flight.tap.told) > first
        assert all(told.holds for told in flight.tap.told[first:])
