"""Frames between processes, by both transports: whole, paired, and through every kind of death."""

import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import peers
from juncnet import topics as t
from juncnet.flight import Flight
from juncnet.frame_ports import FrameTransport
from juncnet.frames import Frame, FrameLayout, FrameReader
from juncnet.frames_wire import ENCODING, PIXELS_KEY, PREFIX_BYTES, PrefixPacker
from juncnet.iceoryx_node import SHARED_MEMORY, IceoryxNode
from juncnet.messages import PixelFormat
from juncnet.zenoh_bus import ZenohBus

TRANSPORTS: tuple[FrameTransport, ...] = ("iceoryx2", "zenoh")


@pytest.fixture(name="flight")
def _flight() -> Iterator[Flight]:
    with peers.a_flight() as flight:
        yield flight


@pytest.fixture(name="transport", params=TRANSPORTS)
def _transport(request: pytest.FixtureRequest) -> FrameTransport:
    if request.param == "iceoryx2":
        pytest.importorskip("iceoryx2")
    return request.param


@pytest.fixture(name="bus")
def _bus(flight: Flight, transport: FrameTransport) -> Iterator[ZenohBus]:
    with peers.member(flight, "beta", transport) as bus:
        yield bus


def take_whole(reader: FrameReader, count: int, timeout_s: float = 10.0) -> list[tuple[int, int]]:
    """Take `count` frames, check each, and return their (epoch, sequence)."""
    taken: list[tuple[int, int]] = []
    deadline = time.monotonic() + timeout_s
    while len(taken) < count and time.monotonic() < deadline:
        with reader.take(0.5) as frame:
            if frame is not None:
                assert peers.is_whole(frame)
                taken.append((frame.header.epoch, frame.header.sequence))
    assert len(taken) == count
    assert taken == sorted(set(taken))
    return taken


def test_two_processes_whole_paired_and_of_changing_size(
    flight: Flight, bus: ZenohBus, transport: FrameTransport
) -> None:
    reader = bus.frames_in(t.CAMERA_FRAME)
    with peers.started("write_frames", flight, "alpha", transport):
        taken = take_whole(reader, 60)
    assert taken[-1][1] - taken[0][1] >= 59  # so at least two changes of size were seen


def test_a_signal_during_a_wait_ends_nothing(bus: ZenohBus) -> None:
    reader = bus.frames_in(t.CAMERA_FRAME)
    before = signal.signal(signal.SIGALRM, lambda _number, _frame: None)
    signal.setitimer(signal.ITIMER_REAL, 0.02, 0.02)
    try:
        with reader.take(0.2) as frame:
            assert frame is None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def test_reader_waits_and_sees_the_newest_only(
    flight: Flight, bus: ZenohBus, transport: FrameTransport
) -> None:
    reader = bus.frames_in(t.CAMERA_FRAME)
    with reader.take(0.01) as frame:
        assert frame is None
    with peers.member(flight, "alpha", transport) as sender:
        writer = sender.frames_out(t.CAMERA_FRAME)
        assert peers.eventually(lambda: _arrives(sender, reader, writer.send))
        before, taken = reader_drops(reader), list[int]()
        assert peers.eventually(lambda: _newest_of_five(sender, reader, writer.send, taken))
        with reader.take(0.05) as frame:
            assert frame is None
        assert reader_drops(reader) - before + len(taken) >= 5


def _arrives(sender: ZenohBus, reader: FrameReader, send: object) -> bool:
    assert callable(send)
    send(peers.picture(sender.stamp()))
    with reader.take(0.2) as frame:
        return frame is not None


def _newest_of_five(
    sender: ZenohBus, reader: FrameReader, send: Callable[[Frame], None], taken: list[int]
) -> bool:
    """Send five at once, take what comes; a busy link may drop the last: a sender never waits."""
    stamps = [sender.stamp() for _ in range(5)]
    for stamp in stamps:
        send(peers.picture(stamp))
    while True:
        with reader.take(0.3) as frame:
            if frame is None:
                return bool(taken) and taken[-1] == stamps[-1].sequence
            taken.append(frame.header.sequence)


def reader_drops(reader: FrameReader) -> int:
    drops: int = getattr(reader, "drops")  # noqa: B009
    return drops


def test_bus_wait_sees_frames(flight: Flight, bus: ZenohBus, transport: FrameTransport) -> None:
    reader = bus.frames_in(t.CAMERA_FRAME, wakes=True)
    assert not bus.wait(0.01)
    with peers.started("write_frames", flight, "alpha", transport):
        assert bus.wait(10.0)
        take_whole(reader, 1)


def test_pixels_stay_while_they_are_held(
    flight: Flight, bus: ZenohBus, transport: FrameTransport
) -> None:
    reader = bus.frames_in(t.CAMERA_FRAME)
    with peers.started("write_frames", flight, "alpha", transport):
        take_whole(reader, 1)
        with reader.take(5.0) as frame:
            assert frame is not None
            assert not frame.pixels.flags.writeable
            before = frame.pixels.copy()
            time.sleep(0.2)  # some twenty frames are sent meanwhile
            np.testing.assert_array_equal(frame.pixels, before)
        take_whole(reader, 5)


def test_writer_killed_and_restarted(
    flight: Flight, bus: ZenohBus, transport: FrameTransport
) -> None:
    reader = bus.frames_in(t.CAMERA_FRAME)
    epochs: set[int] = set()
    for _ in range(3):
        with peers.started("write_frames", flight, "alpha", transport) as writer:
            epochs.add(take_whole(reader, 10)[-1][0])
            writer.send_signal(signal.SIGKILL)
    assert len(epochs) == 3


def test_readers_killed_while_holding_a_frame(
    flight: Flight, bus: ZenohBus, transport: FrameTransport
) -> None:
    reader = bus.frames_in(t.CAMERA_FRAME)
    with peers.started("write_frames", flight, "alpha", transport) as writer:
        for _ in range(3):
            with peers.started("hold_a_frame", flight, "gamma", transport) as holder:
                assert holder.stdout is not None
                assert holder.stdout.readline() == "holding\n"
                holder.kill()
            take_whole(reader, 10)
        assert writer.poll() is None


def test_nothing_is_left_in_shared_memory(flight: Flight) -> None:
    pytest.importorskip("iceoryx2")

    def left() -> list[Path]:
        return list(SHARED_MEMORY.glob(f"{flight.tag}_*"))

    with (
        peers.member(flight, "beta", "iceoryx2") as bus,
        peers.started("write_frames", flight, "alpha", "iceoryx2"),
    ):
        take_whole(bus.frames_in(t.CAMERA_FRAME), 5)
        assert left()
    assert left() == []  # the writer was killed: the reader's end cleared its remains
    with peers.started("hold_a_frame", flight, "gamma", "iceoryx2"):
        assert peers.eventually(lambda: len(left()) > 0)
    with peers.a_flight() as another, peers.member(another, "beta", "iceoryx2") as bus:
        bus.frames_out(t.CAMERA_FRAME)  # whoever starts next clears what a dead flight left
        assert left() == []


def test_a_folder_called_iox_outside_of_flights_is_kept() -> None:
    pytest.importorskip("iceoryx2")
    with tempfile.TemporaryDirectory(prefix="jn-") as folder:
        own = Path(folder) / "iox" / "mine.txt"
        own.parent.mkdir()
        own.write_text("mine")
        IceoryxNode(Flight("outside", Path(folder), "robot", ())).close()
        assert own.read_text() == "mine"


def test_damaged_frames_are_counted_and_survived(
    flight: Flight, bus: ZenohBus, transport: FrameTransport
) -> None:
    reader = bus.frames_in(t.CAMERA_FRAME)
    with peers.member(flight, "alpha", transport) as sender:
        writer = sender.frames_out(t.CAMERA_FRAME)
        assert peers.eventually(lambda: _arrives(sender, reader, writer.send))
        frame = peers.picture(sender.stamp())
        good = PrefixPacker(1).pack(frame.header, frame.layout)
        bad = bytearray(good)
        bad[20] ^= 1
        assert len(good) == PREFIX_BYTES
        key = t.CAMERA_FRAME.expression("robot")
        session: Any = sender.session
        whole = f"{key}/{PIXELS_KEY}"
        for payload in (b"", b"x" * 300, bytes(bad), good[:-1]):
            session.put(key, payload, encoding=ENCODING)
            session.put(whole, payload, encoding=ENCODING)
        session.put(whole, good + b"too short", encoding=ENCODING)
        expected = 4 if transport == "iceoryx2" else 9
        assert peers.eventually(lambda: _errors_after_take(bus, reader) == expected)
        assert peers.eventually(lambda: _arrives(sender, reader, writer.send))


def _errors_after_take(bus: ZenohBus, reader: FrameReader) -> int:
    with reader.take(0.01):
        pass
    return errors(bus)


def errors(bus: ZenohBus) -> int:
    return bus.health.report(bus.stamp(), bus.flight, 0, 0).errors


def test_a_wrong_sample_in_shared_memory_is_an_error(flight: Flight) -> None:
    pytest.importorskip("iceoryx2")
    with (
        peers.member(flight, "beta", "iceoryx2") as bus,
        peers.member(flight, "alpha", "iceoryx2") as sender,
    ):
        reader = bus.frames_in(t.CAMERA_FRAME)
        writer = sender.frames_out(t.CAMERA_FRAME)
        assert peers.eventually(lambda: _arrives(sender, reader, writer.send))
        loan = writer.loan(FrameLayout.packed(PixelFormat.GRAY8, 64, 64))
        sample = vars(loan)["_sample"]
        sample.assume_init().send()  # without its prefix
        with reader.take(0.3) as frame:
            assert frame is None
        assert errors(bus) == 1
        assert peers.eventually(lambda: _arrives(sender, reader, writer.send))


def test_two_flights_do_not_hear_each_other(transport: FrameTransport) -> None:
    with (
        peers.a_flight() as one,
        peers.a_flight() as other,
        peers.member(one, "beta", transport) as here,
        peers.member(other, "beta", transport) as there,
        peers.started("write_frames", one, "alpha", transport),
    ):
        elsewhere = there.frames_in(t.CAMERA_FRAME)
        take_whole(here.frames_in(t.CAMERA_FRAME), 10)
        with elsewhere.take(0.3) as frame:
            assert frame is None


def test_a_loan_that_is_not_sent_is_given_back(
    flight: Flight, bus: ZenohBus, transport: FrameTransport
) -> None:
    writer = bus.frames_out(t.CAMERA_FRAME)
    layout = FrameLayout.packed(PixelFormat.GRAY8, 64, 64)
    for _ in range(20):
        writer.loan(layout)
    reader = bus.frames_in(t.CAMERA_FRAME)
    assert peers.eventually(lambda: _arrives(bus, reader, writer.send))
