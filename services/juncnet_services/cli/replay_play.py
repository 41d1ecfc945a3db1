"""A recording played into the topics that it came from, in its own time."""

import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from juncnet.assets import asset_path
from juncnet.flight import new_flight
from juncnet.frames import Frame
from juncnet.launch import connect
from juncnet.layout import SAVED, Layout, LinksOptions, load_layout
from juncnet.links import ROUTER, member
from juncnet.messages import JunctionEvent, NavigationState
from juncnet.recording.reader import Recorded, Recording, RecordingError
from juncnet.recording.timeline import Shift, due, epochs_of, restamped
from juncnet.recording.video import VideoDecoder
from juncnet.topics import (
    CAMERA_FRAME,
    CAMERA_VIDEO,
    JUNCTION_EVENT,
    MODEL_ACTIVE,
    NAVIGATION_STATE,
    VEHICLE_STATE,
    health_topic,
)
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.cli.demo import DASHBOARD, RECORDER, mission_toml
from juncnet_services.cli.replay_pictures import ViewerPictures
from juncnet_services.cli.supervise import Supervisor

REPLAYED = ("radon_preprocessing", "junction_inference", "road_following", "junction_navigation")
"""The services between what a camera and a vehicle say and what the vehicle is told."""
INPUTS = (CAMERA_VIDEO.key, VEHICLE_STATE.key)
CAMERA = "frame_capture"
"""Who we are for viewers: the first of the services."""
LIVE = tuple(health_topic(name) for name in (ROUTER, DASHBOARD, RECORDER))
"""What viewers do not get: such processes may run now, and tell of themselves."""
START_S = 60.0
AFTER_S = 2.0
CAPACITY = 1000


@dataclass(frozen=True)
class Happened:
    """A junction event without its time: what must be the same in a replay."""

    kind: str
    count: int
    turn: str

    @classmethod
    def of(cls, event: JunctionEvent) -> "Happened":
        """Return what happened in an event."""
        turn = "" if event.turn is None else event.turn.model_dump_json(exclude_none=True)
        return cls(str(event.kind), event.count, turn)

    def __str__(self) -> str:
        return f"{self.kind} {self.count} {self.turn}".strip()


@dataclass(frozen=True)
class Comparison:
    """Events of the flight beside those of its replay, in order."""

    recorded: tuple[Happened, ...]
    replayed: tuple[Happened, ...]

    @property
    def same(self) -> bool:
        """Whether the replay decided what the flight did."""
        return self.recorded == self.replayed

    def fields(self) -> dict[str, Any]:
        """Return the comparison as JSON has it."""
        return {
            "same": self.same,
            "recorded": [str(e) for e in self.recorded],
            "replayed": [str(e) for e in self.replayed],
        }

    def text(self) -> str:
        """Return the comparison for a person."""
        longest = max(len(self.recorded), len(self.replayed))
        rows = [f"{'recorded':<48} replayed"]
        for index in range(longest):
            was = str(self.recorded[index]) if index < len(self.recorded) else "-"
            now = str(self.replayed[index]) if index < len(self.replayed) else "-"
            rows.append(f"{was:<48} {now}{'' if was == now else '   <- differs'}")
        rows.append(f"{len(self.recorded)} events, {'the same' if self.same else 'NOT the same'}")
        return "\n".join(rows)


def recorded_events(recording: Recording) -> list[JunctionEvent]:
    """Return the junction events of a recording, each once, in order."""
    found: dict[tuple[str, int], JunctionEvent] = {}
    for item in recording.messages([JUNCTION_EVENT.key]):
        event: JunctionEvent = item.message
        found.setdefault((event.flight, event.index), event)
    return list(found.values())


def recorded_layout(recording: Recording, folder: Path, settings: Sequence[str]) -> Layout:
    """Return the layout of the services to replay into, with the recorded mission.

    Raises:
        RecordingError: the recording has no layout.
        LayoutError: its options are not those of the present version.
    """
    if recording.layout is None:
        raise RecordingError(f"{recording.files[0]}: it holds no layout to start services with")
    path = folder / SAVED
    path.write_text(recording.layout)
    states = (item.message for item in recording.messages([NAVIGATION_STATE.key]))
    first: NavigationState | None = next(states, None)
    mission = () if first is None else (mission_toml(first.mission),)
    missions = [f"junction_navigation.mission={m}" for m in mission]
    whole = load_layout(path, [*missions, *settings])
    return _only(whole, REPLAYED)


def _only(layout: Layout, processes: Sequence[str]) -> Layout:
    """Return the layout of those of its processes that are named, linked with no other host.

    What is replayed must reach no vehicle.
    """
    kept = tuple(name for name in layout.processes if name in processes)
    sections = {name: table for name, table in layout.sections.items() if name in kept}
    alone = {"processes": kept, "sections": sections, "links": LinksOptions()}
    return layout.model_copy(update=alone)


def fly(
    recording: Recording, speed: float, wait: Callable[[], None] | None, settings: Sequence[str]
) -> Comparison:
    """Play camera and vehicle into services started for it; return both series of events.

    Raises:
        RecordingError: the recording has no video or no layout.
        ConnectionError: the services did not start.
    """
    with tempfile.TemporaryDirectory(prefix="jn-") as folder:
        layout = recorded_layout(recording, Path(folder), settings)
        with _joined(layout, Path(folder)) as bus:
            events = bus.subscribe(JUNCTION_EVENT, CAPACITY)
            _wait_for_services(bus)
            _play(bus, recording, INPUTS, speed, wait)
            time.sleep(AFTER_S)
            heard = {(e.flight, e.index): Happened.of(e) for _, e in events.drain()}
    recorded = tuple(Happened.of(e) for e in recorded_events(recording))
    return Comparison(recorded, tuple(heard.values()))


def show(recording: Recording, speed: float, wait: Callable[[], None] | None) -> None:
    """Publish everything as it was recorded, for viewers; no service of ours runs."""
    layout = _only(load_layout(asset_path("local", "layouts", ".toml")), [ROUTER])
    options = layout.launch.model_copy(update={"robot": recording.robot})
    with (
        tempfile.TemporaryDirectory(prefix="jn-") as folder,
        _joined(layout.model_copy(update={"launch": options}), Path(folder), CAMERA) as bus,
    ):
        print(f"replaying in {bus.flight_dir}: juncnet events, juncnet dashboard", file=sys.stderr)
        _play(bus, recording, None, speed, wait)


@contextmanager
def _joined(layout: Layout, folder: Path, name: str = "") -> Generator[ZenohBus]:
    """Start the processes of a layout, join them, and end them afterwards.

    `name`: of the process that we stand for. Tools that visit the flight find us by it; as visitors
    of the flight ourselves we would be heard by its processes only.
    """
    path = folder / SAVED
    layout.save(path)
    flight = new_flight(layout.launch.robot, (*layout.processes, *([name] if name else [])))
    supervisor = Supervisor(flight.directory)
    state = f'launch.state_dir="{flight.directory}/state"'
    arguments = ["--layout", str(path), "--flight-dir", str(flight.directory), "--set", state]
    try:
        supervisor.start(layout.processes, arguments, foreground=True)
        if name:
            with ZenohBus(member(flight, name), flight, name, flight.directory) as bus:
                yield bus
        else:
            with connect(flight.directory, timeout_s=START_S) as bus:
                yield bus
    finally:
        supervisor.stop()
        shutil.rmtree(flight.directory, ignore_errors=True)


def _wait_for_services(bus: ZenohBus) -> None:
    models = bus.subscribe(MODEL_ACTIVE, wakes=False)
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        if models.newest is not None and set(REPLAYED) <= bus.alive():
            return
        bus.wait(0.1)
    raise ConnectionError(f"the services did not start within {START_S:.0f} s")


def _play(
    bus: ZenohBus,
    recording: Recording,
    topics: Iterable[str] | None,
    speed: float,
    wait: Callable[[], None] | None,
) -> None:
    """Publish the recorded messages of `topics` when they are due, restamped to now."""
    writer, decoder = bus.frames_out(CAMERA_FRAME), VideoDecoder()
    epochs = epochs_of(recording.messages([CAMERA_VIDEO.key]))
    if not epochs:
        raise RecordingError(f"{recording.files[0]}: it holds no video")
    viewers, shift = ViewerPictures(bus) if topics is None else None, None
    began = time.monotonic()
    for due_s, item in due(recording.messages(topics), speed):
        if viewers is not None and item.topic in LIVE:
            continue
        if wait is None:
            time.sleep(max(0.0, began + due_s - time.monotonic()))
        if shift is None or wait is not None:
            shift = _shift(bus, recording, item, speed, epochs)
        if item.topic.key == CAMERA_VIDEO.key:
            if wait is not None:
                wait()
            for frame in decoder.decode(item.message):
                header = shift.stamp(frame.header)
                loan = writer.loan(frame.layout)
                loan.pixels[:] = frame.pixels
                loan.send(header)
                if viewers is not None:
                    viewers.show(Frame(header, frame.layout, frame.pixels))
        if viewers is not None and item.topic.key == MODEL_ACTIVE.key:
            viewers.serve(item.message)
        if topics is None or item.topic.key != CAMERA_VIDEO.key:
            bus.publish(item.topic, restamped(item.message, shift))


def _shift(
    bus: ZenohBus, recording: Recording, item: Recorded, speed: float, epochs: tuple[int, ...]
) -> Shift:
    """Return the shift by which what came with `item` comes now."""
    came_ns = item.time_ns - int(recording.metadata["wall_minus_clock_ns"])
    return Shift(came_ns, bus.clock.now_ns(), bus.clock.id, bus.epoch, speed, epochs)
