"""Writes a report: collects, draws, puts the page together."""

import tempfile
from pathlib import Path

import cv2

from juncnet.layout import LayoutError, load_layout
from juncnet.recording.reader import Recording
from juncnet.simulation.routes import route_of
from juncnet.simulation.world import World
from juncnet_services.report.aerial import aerial
from juncnet_services.report.flight_data import FlightData, collect
from juncnet_services.report.flight_map import turn_words
from juncnet_services.report.key_frames import KeyFrame, key_frames
from juncnet_services.report.page import page
from juncnet_services.report.plots import draw_all
from juncnet_services.report.verdict import verdict
from juncnet_services.simulator.setup import Config as SimulatorConfig
from juncnet_services.simulator.setup import make_world

JPEG_QUALITY = 82


def write_report(recording: Recording, out: Path) -> list[Path]:
    """Write the report to `out` and its pictures into a folder beside it; return all files.

    Raises:
        RecordingError: the recording cannot be read.
        OSError: the files cannot be written.
    """
    data = collect(recording)
    folder = out.with_suffix("")
    world, frames = _world(recording), key_frames(recording, data.events, data.model)
    plots = draw_all(data, None if world is None else aerial(world), frames, folder)
    strip = [_saved(frame, folder, data) for frame in frames]
    out.write_text(page(recording, data, verdict(data, _planned(world, data)), plots, strip))
    return [out, *plots.values(), *(file for _, *pair in strip for file in pair)]


def _saved(frame: KeyFrame, folder: Path, data: FlightData) -> tuple[str, Path, Path]:
    event = frame.marked.event
    turned = {m.event.count: m.event.turn for m in data.turns}
    turn = turned.get(event.count)
    what = "" if turn is None else f", {turn_words(turn)}"
    title = f"junction {event.count}: p = {event.probability:.2f}{what}"
    picture, radon = (folder / f"junction-{event.count}{end}" for end in (".jpg", "-radon.png"))
    cv2.imwrite(str(picture), frame.picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    cv2.imwrite(str(radon), frame.reconstruction)
    return title, picture, radon


def _planned(world: World | None, data: FlightData) -> tuple[int, ...]:
    """Return the directed roads of the mission; none where world or mission are not known."""
    if world is None or data.navigation is None:
        return ()
    try:
        return route_of(world, data.navigation.mission).path
    except ValueError:  # a mission that never finishes has no end to hold the flight against
        return ()


def _world(recording: Recording) -> World | None:
    """Return the simulated world of the recording's layout; None for a real flight."""
    if recording.layout is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "layout.json"
        path.write_text(recording.layout)
        try:
            layout = load_layout(path)
            if "simulator" not in layout.processes:
                return None
            return make_world(layout.section("simulator", SimulatorConfig))
        except LayoutError:  # of another version: a report without its map is still a report
            return None
