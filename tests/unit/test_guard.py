"""The guard, with real processes and a real vehicle socket."""

import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from juncnet_services.command_output.guard_link import GuardLink
from juncnet_services.command_output.vehicles import Hold

HOLD = b"hold"
SECOND_HOLD = b"second hold"
MOVE = b"move"
LIMIT_S = 0.2

DRIVER = """
import socket, sys, time
from pathlib import Path
from juncnet_services.command_output.guard_link import GuardLink
from juncnet_services.command_output.vehicles import Hold

directory, hold = Path(sys.argv[1]), sys.argv[2].encode()
link = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
address = str(directory / "vehicle.sock")
with GuardLink(Hold(link.fileno(), address, (hold,)), directory) as guard:
    print(guard.pid, flush=True)
    while not (directory / "end").exists():
        guard.beat(0.17)
        link.sendto(b"move", address)
        time.sleep(0.04)
"""
"""Accepts a command and sends it to the vehicle every 40 ms, as command_output does."""


class World:
    """A vehicle that keeps what it hears, and the drivers of it."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.vehicle = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.vehicle.bind(str(directory / "vehicle.sock"))
        self.vehicle.settimeout(5.0)
        self.guards: list[psutil.Process] = []
        self.drivers: list[subprocess.Popen[str]] = []

    def start(self, hold: bytes = HOLD) -> subprocess.Popen[str]:
        driver = subprocess.Popen(
            [sys.executable, "-c", DRIVER, str(self.directory), hold.decode()],
            stdout=subprocess.PIPE,
            text=True,
        )
        self.drivers.append(driver)
        assert driver.stdout is not None
        self.guards.append(psutil.Process(int(driver.stdout.readline())))
        driver.stdout.close()
        self.until(MOVE)
        return driver

    def hear(self) -> tuple[bytes, float]:
        """Return the next packet and when it was heard."""
        packet = self.vehicle.recv(100)
        return packet, time.monotonic()

    def until(self, wanted: bytes, packets: int = 400) -> float:
        """Return when `wanted` was first heard from now on."""
        for _ in range(packets):
            packet, heard_s = self.hear()
            if packet == wanted:
                return heard_s
        raise AssertionError(f"{wanted!r} was not among {packets} packets")

    def first_hold_after_the_last_move(self) -> float:
        """Return the seconds between the last move and the first hold."""
        last_s = time.monotonic()
        while True:
            packet, heard_s = self.hear()
            if packet == HOLD:
                return heard_s - last_s
            last_s = heard_s

    def discard(self) -> None:
        """Forget what was sent and not yet heard."""
        while select.select([self.vehicle], [], [], 0)[0]:
            self.vehicle.recv(100)

    def silent(self, seconds: float) -> bool:
        """Return whether nothing is heard for `seconds`."""
        self.vehicle.settimeout(seconds)
        try:
            self.vehicle.recv(100)
        except TimeoutError:
            return True
        finally:
            self.vehicle.settimeout(5.0)
        return False


def children(driver: subprocess.Popen[str]) -> list[psutil.Process]:
    return psutil.Process(driver.pid).children()


@contextmanager
def world_in(directory: Path) -> Generator[World]:
    world = World(directory)
    hurry()
    try:
        yield world
    finally:
        for driver in world.drivers:
            driver.kill()
            driver.wait(5)
        for guard in world.guards:
            if guard.is_running():
                guard.kill()
        world.vehicle.close()
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def hurry() -> None:
    """Have times taken here, where that is allowed, when packets come, however busy the machine."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(2))
    except PermissionError:
        return


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with world_in(tmp_path) as made:
        yield made


def test_holds_in_time_when_its_parent_is_killed_and_goes_on_holding(world: World) -> None:
    driver = world.start()
    driver.kill()
    assert world.first_hold_after_the_last_move() < LIMIT_S
    for _ in range(5):
        assert world.hear()[0] == HOLD


def test_holds_in_time_when_its_parent_is_stopped_and_yields_when_it_goes_on(world: World) -> None:
    driver = world.start()
    driver.send_signal(signal.SIGSTOP)
    assert world.first_hold_after_the_last_move() < LIMIT_S
    driver.send_signal(signal.SIGCONT)
    world.until(MOVE)
    moves, deadline_s = 0, time.monotonic() + 5
    while moves < 10:
        moves = moves + 1 if world.hear()[0] == MOVE else 0
        assert time.monotonic() < deadline_s


def test_a_clean_end_leaves_no_process_and_no_packet(world: World) -> None:
    driver = world.start()
    (world.directory / "end").touch()
    assert driver.wait(5) == 0
    assert not world.guards[0].is_running()
    world.discard()
    assert world.silent(0.2)


def test_a_successor_ends_the_guard_of_its_dead_predecessor(world: World) -> None:
    world.start().kill()
    world.until(HOLD)
    world.start(SECOND_HOLD)
    world.guards[0].wait(5)
    world.discard()
    assert HOLD not in [world.hear()[0] for _ in range(10)]


def test_survives_the_signals_that_end_its_parent_and_stays_out_of_its_group(world: World) -> None:
    driver = world.start()
    guard = world.guards[0]
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        guard.send_signal(number)
    assert os.getpgid(guard.pid) != os.getpgid(driver.pid)
    driver.kill()
    assert world.first_hold_after_the_last_move() < LIMIT_S


def test_a_dead_guard_is_replaced(world: World) -> None:
    driver = world.start()
    world.guards[0].kill()
    deadline_s = time.monotonic() + 5
    while not (successors := [c for c in children(driver) if c != world.guards[0]]):
        world.hear()
        assert time.monotonic() < deadline_s
    world.guards += successors
    driver.kill()
    assert world.first_hold_after_the_last_move() < LIMIT_S


def test_goes_on_when_the_vehicle_vanishes(world: World) -> None:
    world.start().kill()
    world.until(HOLD)
    (world.directory / "vehicle.sock").unlink()
    world.vehicle.close()
    world.vehicle = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    world.vehicle.settimeout(5.0)
    world.vehicle.bind(str(world.directory / "vehicle.sock"))
    assert world.hear()[0] == HOLD


def test_without_a_link_yet_the_predecessors_guard_goes_on_holding(world: World) -> None:
    world.start().kill()
    world.until(HOLD)
    link = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    address = str(world.directory / "vehicle.sock")
    with GuardLink(None, world.directory) as successor:
        successor.beat(10.0, None)
        assert successor.pid is None
        world.until(HOLD)
        successor.beat(10.0, Hold(link.fileno(), address, (SECOND_HOLD,)))
        world.guards[0].wait(5)
        successor.beat(0.0)
        world.until(SECOND_HOLD)
        successor.beat(0.0, Hold(link.fileno(), address, (b"a", b"b"), step_ns=1_000_000_000))
        numbered = (b"b", b"a")[time.monotonic_ns() // 1_000_000_000 % 2 == 0]
        world.until(numbered)
    link.close()
