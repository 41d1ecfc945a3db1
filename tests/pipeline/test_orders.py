"""To which flight an order goes: never to another robot's, never to one that does not run."""

import io
import threading
from collections.abc import Generator, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

import peers
from flights import flights_folder
from juncnet.flight import Flight, flights_root, new_flight
from juncnet.launch import connect
from juncnet.layout import SAVED
from juncnet_services.cli import local_flights, manual, operator
from juncnet_services.cli.local_flights import flights_to_order
from juncnet_services.command_output.latch import LATCH
from juncnet_services.command_output.service import Config, run


@contextmanager
def robot(name: str) -> Generator[Flight]:
    """Run a command_output of a robot called so, as one that was started by hand, in a thread."""
    flight = new_flight(name, ("command_output",))
    with peers.member(flight, "command_output") as bus:
        thread = threading.Thread(target=run, args=(bus, Config(vehicle="log")))
        thread.start()
        try:
            yield flight
        finally:
            bus.stop()
            thread.join(10.0)


def is_stopped(flight: Flight) -> bool:
    return (flight.directory / LATCH).exists()


@pytest.fixture(name="folder", autouse=True)
def _folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    with flights_folder(monkeypatch) as folder:
        yield folder


@pytest.fixture(name="two")
def _two() -> Iterator[tuple[Flight, Flight]]:
    with ExitStack() as stack:
        yield stack.enter_context(robot("alpha")), stack.enter_context(robot("beta"))


def test_an_order_goes_to_the_robot_that_is_named(
    two: tuple[Flight, Flight], capsys: pytest.CaptureFixture[str]
) -> None:
    alpha, beta = two
    assert operator.main(["stop", "--robot", "alpha"]) == 0
    assert "stop: obeyed after" in capsys.readouterr().out
    assert (is_stopped(alpha), is_stopped(beta)) == (True, False)
    assert operator.main(["resume", "--robot", "alpha"]) == 0
    assert not is_stopped(alpha)


def test_stop_stops_every_robot_that_it_can_mean(
    two: tuple[Flight, Flight], capsys: pytest.CaptureFixture[str]
) -> None:
    assert operator.main(["stop"]) == 0
    assert all(is_stopped(flight) for flight in two)
    told = capsys.readouterr()
    assert "2 flights run here: all are stopped" in told.err
    lines = sorted(told.out.splitlines())
    assert [line.partition(" in ")[0] for line in lines] == ["alpha", "beta"]
    assert all("stop: obeyed after" in line for line in lines)


def test_stop_is_obeyed_only_if_all_obey(
    two: tuple[Flight, Flight], capsys: pytest.CaptureFixture[str]
) -> None:
    with peers.member(new_flight("gamma", ("command_output",)), "command_output"):
        assert operator.main(["stop", "--timeout", "1"]) == 1
    assert all(is_stopped(flight) for flight in two)
    assert "gamma" in capsys.readouterr().err


@pytest.mark.parametrize("order", ["land", "resume", "takeoff", "emergency"])
def test_other_orders_are_given_to_no_robot_while_several_run(
    two: tuple[Flight, Flight], order: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert operator.main([order]) == 1
    told = capsys.readouterr().err
    assert "2 flights run here: name one with --robot or --flight" in told
    assert all(f"--robot {f.robot}    --flight {f.directory}" in told for f in two)
    assert not any(is_stopped(flight) for flight in two)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.usefixtures("two")
def test_nobody_flies_by_hand_while_several_run(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal())
    monkeypatch.setattr("sys.stdout", Terminal())
    assert manual.main([]) == 1
    assert "juncnet manual: 2 flights run here" in capsys.readouterr().err


def test_an_order_passes_over_flights_that_do_not_run(capsys: pytest.CaptureFixture[str]) -> None:
    with robot("alpha") as alpha:
        new_flight("dead", ("command_output",))
        replay = new_flight("alpha", ("junction_navigation",))
        (replay.directory / SAVED).write_text('{"processes": ["junction_navigation"]}')
        with peers.member(replay, "junction_navigation"):
            assert flights_to_order() == [alpha]
            assert operator.main(["stop"]) == 0
        assert is_stopped(alpha)
    capsys.readouterr()
    assert operator.main(["stop", "--robot", "alpha"]) == 1
    assert "no flight of robot alpha runs in" in capsys.readouterr().err


def test_a_flight_of_a_vehicle_on_another_host_takes_orders() -> None:
    laptop = new_flight("robot", ("junction_navigation",))
    links = '{"vehicle": "127.0.0.1:7447"}'
    text = f'{{"processes": ["junction_navigation"], "links": {links}}}'
    (laptop.directory / SAVED).write_text(text)
    with peers.member(laptop, "junction_navigation"):
        assert flights_to_order() == [laptop]


def test_a_flight_that_ends_meanwhile_hinders_no_order(monkeypatch: pytest.MonkeyPatch) -> None:
    with robot("alpha") as alpha:
        gone = new_flight("gone", ("command_output",)).directory
        root = flights_root()

        class Root:
            def glob(self, pattern: str) -> list[Path]:
                found = list(root.glob(pattern))
                (gone / "flight.json").unlink(missing_ok=True)
                return found

        monkeypatch.setattr(operator, "flights_root", Root)
        monkeypatch.setattr(local_flights, "flights_root", Root)
        assert operator.main(["stop"]) == 0
        assert is_stopped(alpha)


def test_who_runs_is_named_where_no_robot_is_called_so(
    two: tuple[Flight, Flight], capsys: pytest.CaptureFixture[str]
) -> None:
    assert operator.main(["stop", "--robot", "aplha"]) == 1
    told = capsys.readouterr().err
    assert "no flight of robot aplha runs in" in told
    assert f"--robot alpha    --flight {two[0].directory}" in told


def test_a_directory_of_another_robot_than_the_named_one_is_refused(
    two: tuple[Flight, Flight], capsys: pytest.CaptureFixture[str]
) -> None:
    alpha, beta = two
    assert operator.main(["land", "--flight", str(beta.directory), "--robot", "alpha"]) == 1
    assert "is a flight of robot 'beta', not 'alpha'" in capsys.readouterr().err
    with pytest.raises(ConnectionError, match="not 'beta'"):
        connect(alpha.directory, "beta")
    assert not is_stopped(alpha)
    assert not is_stopped(beta)
    assert operator.main(["stop", "--flight", str(beta.directory), "--robot", "beta"]) == 0
    assert (is_stopped(alpha), is_stopped(beta)) == (False, True)
