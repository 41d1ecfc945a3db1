"""`juncnet bench hop`: how long a frame and a small message take from process to process.

The transports take turns within one run, so that all see the same machine. A hop begins when the
sender has a numpy picture and ends when the receiver has read a numpy picture's first and last
byte: one copy is in all of them, where memory is shared into memory that lay ready before. "plain
zenoh over TCP" is Zenoh's Python API alone: bytes put on one side, bytes received on the other, a
time stamp before them and no contract.
"""

import argparse
import multiprocessing as mp
import queue
import socket
import tempfile
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from juncnet import links
from juncnet.flight import Flight, new_flight
from juncnet.frames import FrameLayout
from juncnet.iceoryx_node import available
from juncnet.messages import PixelFormat, Velocity, VelocityCommand
from juncnet.topics import CAMERA_FRAME, COMMAND_VELOCITY
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.bench.figures import Figure, median, p99, show

Transport = Literal["iceoryx2", "zenoh", "shared memory + pipe", "pipe", "plain zenoh over TCP"]
TARGET_RATIO = 1.4
BASELINE = "shared memory + pipe"
PLAIN = "plain zenoh over TCP"
PLAIN_KEY = "bench/frame"
WARM_UP = 10
ROUNDS = 3
"""The transports take turns this often."""
PROCESSES = ("sender", "receiver")


def main(argv: list[str]) -> int:
    """Measure and print; 0 if the target is reached."""
    parser = argparse.ArgumentParser(prog="juncnet bench hop", description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each measurement")
    parser.add_argument("--rate", type=float, default=30.0, help="frames a second")
    options = parser.parse_args(argv)
    figures: list[Figure] = []
    for pixel_format in (PixelFormat.I420, PixelFormat.BGR8):
        layout = FrameLayout.packed(pixel_format, 1920, 1080)
        figures += _frame_figures(layout, options.seconds, options.rate)
    figures.append(_summary("200-byte command", _measure(_command, (), options.seconds, 100.0)))
    show(figures, options.json)
    return 0 if all(figure.reached is not False for figure in figures) else 1


def _frame_figures(layout: FrameLayout, seconds: float, rate_hz: float) -> list[Figure]:
    transports: list[Transport] = ["shared memory + pipe", "zenoh", "pipe", "plain zenoh over TCP"]
    if available():
        transports.insert(0, "iceoryx2")
    ours = "iceoryx2" if available() else "zenoh"
    hops: dict[str, list[float]] = {name: [] for name in transports}
    for _ in range(ROUNDS):
        for name in transports:
            hops[name] += _measure(_frames, (name, layout), seconds / ROUNDS, rate_hz)
    label = f"1080p {layout.format}"
    figures = [_summary(f"{label}, {name}", hops[name]) for name in transports]
    base = median(hops[BASELINE])
    for name in ("iceoryx2", "zenoh", PLAIN):
        if name in hops:
            ratio, title = median(hops[name]) / base, f"{label}, {name} / {BASELINE}"
            if name == ours:
                figures.append(Figure.against(title, ratio, "x", TARGET_RATIO, at_most=True))
            else:
                figures.append(Figure(name=title, value=ratio, unit="x"))
    return figures


def _summary(name: str, hops_ms: list[float]) -> Figure:
    return Figure(name=name, value=median(hops_ms), unit="ms", p99=p99(hops_ms), n=len(hops_ms))


def _measure(
    work: Callable[..., None], arguments: tuple[Any, ...], seconds: float, rate_hz: float
) -> list[float]:
    """Run both ends of `work` in processes of their own; return the hops in ms."""
    context = mp.get_context("spawn")
    count = WARM_UP + max(10, round(seconds * rate_hz))
    results, reporting = context.Pipe(False)
    down, up = context.Pipe(False)
    with tempfile.TemporaryDirectory(prefix="jn-") as root:
        flight = new_flight("bench", PROCESSES, Path(root))
        ends = [
            context.Process(
                target=work, args=(flight, name, count, rate_hz, pipe, reporting, *arguments)
            )
            for name, pipe in zip(PROCESSES, (up, down), strict=True)
        ]
        for end in reversed(ends):
            end.start()
        try:
            if not results.poll(30 + 3 * count / rate_hz):
                raise TimeoutError(f"{arguments}: no frame came through")
            hops: list[float] = results.recv()
        finally:
            for end in ends:
                end.join(2.0)
                end.kill()
    return hops[WARM_UP:]


def _frames(
    flight: Flight,
    name: str,
    count: int,
    rate_hz: float,
    pipe: Connection,
    reporting: Connection,
    transport: Transport,
    layout: FrameLayout,
) -> None:
    """One end of a transport of frames; the receiver reports the hops, in ms."""
    if transport in ("iceoryx2", "zenoh"):
        settings = links.member(flight, name)
        with ZenohBus(settings, flight, name, flight.directory, transport) as bus:
            if name == "sender":
                _send_over_bus(bus, layout, rate_hz)
            else:
                reporting.send(_receive_over_bus(bus, count))
                (flight.directory / "done").touch()
    elif transport == PLAIN:
        _plain_zenoh(flight, name, count, rate_hz, pipe, reporting, layout)
    elif transport == BASELINE:
        _shared_memory(flight, name, count, rate_hz, pipe, reporting, layout)
    elif name == "sender":
        source = _picture(layout)
        for _ in _ticks(rate_hz, count):
            started = time.monotonic_ns()
            pipe.send_bytes(started.to_bytes(8, "little"))
            pipe.send_bytes(source.data)
    else:
        reporting.send([_pipe_hop(pipe) for _ in range(count)])


def _plain_zenoh(
    flight: Flight,
    name: str,
    count: int,
    rate_hz: float,
    pipe: Connection,
    reporting: Connection,
    layout: FrameLayout,
) -> None:
    settings, done = links.member(flight, name), flight.directory / "done"
    if name == "sender":
        with socket.create_server(("127.0.0.1", 0)) as probe:
            endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        settings["listen"]["endpoints"], settings["connect"]["endpoints"] = [endpoint], []
        source = _picture(layout)
        with ZenohBus(settings, flight, name, flight.directory) as bus:
            pipe.send(endpoint)
            publisher: Any = bus.session.declare_publisher(PLAIN_KEY)
            for _ in _ticks(rate_hz, 100_000):
                if done.exists():
                    return
                publisher.put(time.monotonic_ns().to_bytes(8, "little") + source.tobytes())
    settings["listen"]["endpoints"], settings["connect"]["endpoints"] = [], [pipe.recv()]
    arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    with ZenohBus(settings, flight, name, flight.directory) as bus:
        _subscriber: Any = bus.session.declare_subscriber(
            PLAIN_KEY, lambda sample: arrived.put(sample.payload.to_bytes())
        )
        reporting.send([_stamped_hop(arrived.get()) for _ in range(count)])
        done.touch()


def _stamped_hop(data: bytes) -> float:
    _touch(np.frombuffer(data, np.uint8, offset=8))
    return (time.monotonic_ns() - int.from_bytes(data[:8], "little")) / 1e6


def _picture(layout: FrameLayout) -> NDArray[np.uint8]:
    return np.random.default_rng(1).integers(0, 255, layout.nbytes, np.uint8)


def _ticks(rate_hz: float, count: int) -> Any:
    start = time.monotonic()
    for index in range(count):
        time.sleep(max(0.0, start + index / rate_hz - time.monotonic()))
        yield index


def _send_over_bus(bus: ZenohBus, layout: FrameLayout, rate_hz: float) -> None:
    source = _picture(layout)
    writer = bus.frames_out(CAMERA_FRAME)
    done = bus.flight_dir / "done"
    for _ in _ticks(rate_hz, 100_000):
        if done.exists():
            return
        loan = writer.loan(layout)
        stamp = bus.stamp()
        loan.pixels[:] = source
        loan.send(stamp)


def _receive_over_bus(bus: ZenohBus, count: int) -> list[float]:
    reader = bus.frames_in(CAMERA_FRAME)
    hops: list[float] = []
    while len(hops) < count:
        with reader.take(1.0) as frame:
            if frame is not None:
                _touch(frame.pixels)
                hops.append((time.monotonic_ns() - frame.header.time_ns) / 1e6)
    return hops


def _touch(pixels: NDArray[np.uint8]) -> int:
    return int(pixels[0]) + int(pixels[-1])


def _shared_memory(
    flight: Flight,
    name: str,
    count: int,
    rate_hz: float,
    pipe: Connection,
    reporting: Connection,
    layout: FrameLayout,
) -> None:
    if name == "sender":
        source = _picture(layout)
        memory = SharedMemory(flight.tag, create=True, size=layout.nbytes)
        target: NDArray[np.uint8] = np.ndarray(layout.nbytes, np.uint8, memory.buf)
        for _ in _ticks(rate_hz, count):
            started = time.monotonic_ns()
            target[:] = source
            pipe.send_bytes(started.to_bytes(8, "little"))
        while not (flight.directory / "done").exists():
            time.sleep(0.01)
        del target
        memory.close()
        memory.unlink()
        return
    hops: list[float] = []
    started = int.from_bytes(pipe.recv_bytes(), "little")
    memory = SharedMemory(flight.tag)
    pixels: NDArray[np.uint8] = np.ndarray(layout.nbytes, np.uint8, memory.buf)
    for index in range(count):
        _touch(pixels)
        hops.append((time.monotonic_ns() - started) / 1e6)
        if index < count - 1:
            started = int.from_bytes(pipe.recv_bytes(), "little")
    reporting.send(hops)
    del pixels
    memory.close()
    (flight.directory / "done").touch()


def _pipe_hop(pipe: Connection) -> float:
    started = int.from_bytes(pipe.recv_bytes(), "little")
    _touch(np.frombuffer(pipe.recv_bytes(), np.uint8))
    return (time.monotonic_ns() - started) / 1e6


def _command(
    flight: Flight,
    name: str,
    count: int,
    rate_hz: float,
    _pipe: Connection,
    reporting: Connection,
) -> None:
    """One end of the small message's hop: encoded, sent, decoded and validated."""
    with ZenohBus(links.member(flight, name), flight, name, flight.directory) as bus:
        done = flight.directory / "done"
        if name == "sender":
            for _ in _ticks(rate_hz, 100_000):
                if done.exists():
                    return
                stamp = bus.stamp()
                message = VelocityCommand(header=stamp, issued=stamp, velocity=Velocity())
                bus.publish(COMMAND_VELOCITY, message)
        inbox = bus.subscribe(COMMAND_VELOCITY, 16)
        hops: list[float] = []
        while len(hops) < count:
            received = inbox.take(1.0)
            if received is not None:
                hops.append((time.monotonic_ns() - received.issued.time_ns) / 1e6)
        reporting.send(hops)
        done.touch()
