"""`juncnet bench pipeline`: the whole pipeline beside its stages in one process, in one run.

1. The stages called in turn in this process, with arrays: each one's time and their sum. Back to
   back their data stays in the processor's caches; at the camera's rate, as the processes work, it
   does not. The processes are held against the latter.
2. The real processes given pre-rendered pictures: latency at the camera's rate, then how many
   pictures a second come out as commands when more are put in than they can take.
3. The real processes in a simulated flight: rate, and CPU of each.

Frame to command is from a picture's capture to the first command that its score and its road are
both in. CPU is in per cent of one core, that of the six services together of two cores.
"""

import argparse
import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager

from juncnet import links
from juncnet.bus import Bus
from juncnet.flight import new_flight
from juncnet.frames import FrameLayout
from juncnet.launch import connect
from juncnet.layout import Layout, LayoutError, load_layout
from juncnet.modelfile import ModelFileError
from juncnet.topics import SERVICES, SIMULATOR_CAMERA
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.bench.figures import Figure, median, p99, show
from juncnet_services.cli.bench.in_process import Picture, Pipeline, pictures
from juncnet_services.cli.bench.measured import Latencies, Listener, flight_cpu_s
from juncnet_services.cli.demo import START_S, Demo, prepare
from juncnet_services.cli.local_flights import end
from juncnet_services.cli.supervise import Supervisor

PICTURES = 50
OVERHEAD_MS, P99_MS, CPU_PERCENT, PUSHED_HZ, RATE_HZ = 2.0, 40.0, 60.0, 100.0, 24.5
"""Targets: over the stages in one process; at the 99th percentile; of two cores; FPS pushed; FPS of
a camera of 25, less what a measurement of some seconds may miss at its ends."""
CAMERA_HZ = 25.0
SIMULATOR = "simulator"
SETTLE_S = 5.0
LOGGED = ('command_output.vehicle="log"',)
"""Where no simulated vehicle flies, commands are logged."""
NO_COMMAND = f"the pipeline gave no command within {START_S:.0f} s"


def in_process(layout: Layout, rounds: int) -> tuple[list[Figure], float]:
    """Return the figures of the stages called in turn, and the median of their sum, ms.

    The sum is that at the camera's rate.
    """
    pipeline = Pipeline(layout)
    frames, taken = pictures(layout, PICTURES)
    pipeline.step(frames, taken[0])
    at_once = [pipeline.step(frames, pixels) for pixels in taken]
    samples: list[dict[str, float]] = []
    started = time.monotonic()
    for index in range(rounds * len(taken)):
        time.sleep(max(0.0, started + index / CAMERA_HZ - time.monotonic()))
        samples.append(pipeline.step(frames, taken[index % len(taken)]))
    figures = [
        _ms(f"in one process: {name}", [sample[name] for sample in samples]) for name in SERVICES
    ]
    sums = [sum(sample.values()) for sample in samples]
    note = f"{len(pipeline.errors)} errors" if pipeline.errors else ""
    figures.append(_ms("in one process: sum", sums, note))
    sums_at_once = [sum(sample.values()) for sample in at_once]
    figures.append(_ms("in one process, back to back: sum", sums_at_once))
    return figures, median(sums)


def _ms(name: str, samples: Sequence[float], note: str = "") -> Figure:
    return Figure(
        name=name, value=median(samples), unit="ms", p99=p99(samples), n=len(samples), note=note
    )


def in_flight(demo: Demo, seconds: float) -> list[Figure]:
    """Return rate, latency and CPU of the real processes during `seconds` of a flight."""
    with demo, connect(demo.flight.directory, timeout_s=START_S) as bus:
        listener = Listener(bus)
        await_commands(bus, listener)
        before, started = flight_cpu_s(demo.supervisor), time.monotonic()
        while time.monotonic() - started < seconds:
            bus.wait(0.05)
            listener.hear()
        took_s = time.monotonic() - started
        after = flight_cpu_s(demo.supervisor)
    used = {name: 100 * (after[name] - before.get(name, 0.0)) / took_s for name in after}
    complete = listener.latencies.complete_ms()
    scored, _, commanded = listener.latencies.pictures
    count = min(scored, commanded)
    return [
        Figure.against("in flight: rate", count / took_s, "FPS", RATE_HZ, n=count),
        _ms("in flight: frame to command", complete, "the simulator's rendering included"),
        *cpu_figures(used),
    ]


def await_commands(bus: Bus, listener: Listener) -> None:
    """Wait until pictures come out as commands and things have settled; forget what came so far.

    Raises:
        ConnectionError: none came within `START_S`.
    """
    deadline = time.monotonic() + START_S
    while min(listener.latencies.pictures) == 0:
        if time.monotonic() > deadline:
            raise ConnectionError(NO_COMMAND)
        bus.wait(0.1)
        listener.hear()
    settled = time.monotonic() + SETTLE_S
    while time.monotonic() < settled:
        bus.wait(0.1)
        listener.hear()
    listener.restart()


def latency_figures(latencies: Latencies, stages_ms: float) -> list[Figure]:
    """Return frame to command, beside the same stages in one process."""
    complete, first = latencies.complete_ms(), latencies.first_ms()
    over, n = median(complete) - stages_ms, len(complete)
    return [
        _ms("frame to command", complete, f"{CAMERA_HZ:.0f} FPS put in, pre-rendered"),
        _ms("frame to first command", first, "with its score or its road, whichever came first"),
        Figure.against("frame to command, over one process", over, "ms", OVERHEAD_MS, True, n=n),
        Figure.against("frame to command, p99", p99(complete), "ms", P99_MS, True, n=n),
    ]


def cpu_figures(used: dict[str, float]) -> list[Figure]:
    """Return CPU by process, per cent of one core, and that of the six, per cent of two."""
    figures = [
        Figure(name=f"CPU {name}", value=value, unit="% core") for name, value in used.items()
    ]
    total = sum(used.get(name, 0.0) for name in SERVICES) / 2
    figures.append(Figure.against("CPU of the six services", total, "% of 2", CPU_PERCENT, True))
    return figures


@contextmanager
def fed_flight(layout: Layout, settings: Sequence[str]) -> Generator["Pusher"]:
    """Run the layout's processes without the simulator; what is yielded takes its place.

    Raises:
        RuntimeError: the supervisor did not start.
    """
    frames, taken = pictures(layout, PICTURES)
    flight = new_flight(layout.launch.robot, layout.processes)
    supervisor = Supervisor(flight.directory)
    arguments = ["--layout", str(layout.path), "--flight-dir", str(flight.directory)]
    for setting in (*settings, f'launch.state_dir="{flight.directory}/state"'):
        arguments += ["--set", setting]
    services = tuple(name for name in layout.processes if name != SIMULATOR)
    try:
        supervisor.start(services, arguments, foreground=True)
        member = links.member(flight, SIMULATOR)
        with ZenohBus(member, flight, SIMULATOR, flight.directory, layout.bus.frames) as bus:
            yield Pusher(bus, frames, taken)
    finally:
        supervisor.stop()
        end(flight, keep=False)


def fed(pusher: "Pusher", seconds: float, rate_hz: float, stages_ms: float) -> list[Figure]:
    """Return the figures of pictures put in at the camera's rate, then at `rate_hz`.

    Raises:
        ConnectionError: the pipeline gave no command.
    """
    pusher.warm_up(CAMERA_HZ)
    pusher.push(seconds, CAMERA_HZ)
    figures = latency_figures(pusher.listener.latencies, stages_ms)
    pusher.warm_up(rate_hz)
    put_in = pusher.push(seconds, rate_hz) / seconds
    scored, seen, commanded = pusher.listener.latencies.pictures
    note = f"{put_in:.0f} FPS put in, pre-rendered"
    return [
        *figures,
        Figure(name="pushed: scored", value=scored / seconds, unit="FPS", n=scored, note=note),
        Figure(name="pushed: road seen", value=seen / seconds, unit="FPS", n=seen),
        Figure.against("pushed: commands", commanded / seconds, "FPS", PUSHED_HZ, n=commanded),
    ]


class Pusher:
    """Puts pictures into a flight in the simulator's place, and hears what comes out."""

    def __init__(self, bus: ZenohBus, frames: FrameLayout, taken: Sequence[Picture]) -> None:
        self._bus, self._frames, self._taken = bus, frames, taken
        self._writer = bus.frames_out(SIMULATOR_CAMERA)
        self.listener = Listener(bus)

    def warm_up(self, rate_hz: float) -> None:
        """Push until pictures come out as commands and things have settled.

        Raises:
            ConnectionError: none came out within `START_S`.
        """
        deadline = time.monotonic() + START_S
        while min(self.listener.latencies.pictures) == 0:
            if time.monotonic() > deadline:
                raise ConnectionError(NO_COMMAND)
            self.push(1.0, rate_hz)
        self.push(SETTLE_S, rate_hz)
        self.listener.restart()

    def push(self, seconds: float, rate_hz: float) -> int:
        """Push for so long, and return how many pictures were put in.

        As in a camera the picture lies in the transport's memory before it gets its stamp.
        """
        started, sent = time.monotonic(), 0
        while time.monotonic() < started + seconds:
            pixels = self._taken[sent % len(self._taken)]
            loan = self._writer.loan(self._frames)
            loan.pixels[:] = pixels
            loan.send(self._bus.stamp())
            sent += 1
            self._listen(until_s=started + sent / rate_hz)
        return sent

    def _listen(self, until_s: float) -> None:
        self.listener.hear()
        while (left_s := until_s - time.monotonic()) > 0:
            self._bus.wait(left_s)
            self.listener.hear()


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet bench pipeline",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--json", action="store_true", help="print a list of figures as JSON")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement")
    parser.add_argument("--rounds", type=int, default=4, help=f"of {PICTURES} pictures, in process")
    parser.add_argument("--push-rate", type=float, default=150.0, metavar="FPS", help="put in")
    parser.add_argument("--seed", type=int, default=1, help="of the world flown")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Measure and print; 0 if all targets are reached, 1 if not, 2 if nothing can be measured."""
    options = arguments(argv)
    try:
        figures = measure(options)
    except (LayoutError, ModelFileError, OSError, ValueError, RuntimeError) as error:
        print(f"juncnet bench pipeline: {error}", file=sys.stderr)
        return 2
    show(figures, options.json)
    return 0 if all(figure.reached is not False for figure in figures) else 1


def measure(options: argparse.Namespace) -> list[Figure]:
    """Return all figures, in the order of the text at the top."""
    demo = Demo(prepare("copter", None, options.seed, None, options.set))
    try:
        figures, stages_ms = in_process(demo.layout, options.rounds)
        settings = (f"simulator.seed={options.seed}", *options.set, *LOGGED)
        layout = load_layout(demo.layout.path, settings)
        with fed_flight(layout, settings) as pusher:
            figures += fed(pusher, options.seconds, options.push_rate, stages_ms)
        figures += in_flight(demo, options.seconds)
    finally:
        demo.discard()
    return figures
