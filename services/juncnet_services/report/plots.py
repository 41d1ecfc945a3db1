"""The plots of a report, as PNG files. Matplotlib draws them."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from juncnet.messages import EventKind
from juncnet_services.report.aerial import Aerial
from juncnet_services.report.flight_data import FlightData
from juncnet_services.report.flight_map import INK, MARK, PATH, draw_map, turn_words
from juncnet_services.report.key_frames import KeyFrame
from juncnet_services.report.surface_maps import draw_surface

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

TRUTH = "#9e9e9e"
PHASES = {
    "following": "#e3f2fd",
    "approaching": "#fff3c4",
    "crossing": "#dcedc8",
    "turning": "#ffccbc",
    "aligning": "#e1bee7",
    "waiting": "#eeeeee",
}
DPI = 110
TURN_COLUMNS, MOST_TURNS = 4, 20
SHOWN = 3
"""Junctions on the overview."""


def draw_all(
    data: FlightData, photo: Aerial | None, frames: Sequence[KeyFrame], folder: Path
) -> dict[str, Path]:
    """Draw every plot that the data allow; return the files by name.

    `photo`: the world from above, where it is known. `frames`: at junctions, where there is video.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawings: dict[str, Callable[[Path], bool]] = {
        "overview": lambda file: overview(data, photo, frames, file),
        "path": lambda file: path(data, photo, file),
        "probability": lambda file: probability(data, file),
        "turns": lambda file: turns(data, file),
        "latency": lambda file: latency(data, file),
    }
    files = {name: folder / f"{name}.png" for name in drawings}
    return {name: files[name] for name, draw in drawings.items() if draw(files[name])}


def path(data: FlightData, photo: Aerial | None, file: Path) -> bool:
    """Draw where the vehicle went, over the map where there is one: the paper's Fig. 1."""
    figure, axes = _figure(9.0, 7.0)
    if not draw_map(axes, data, photo, 13.0):
        plt.close(figure)
        return False
    axes.set_title(f"junctions counted: {data.counted}, turns taken: {len(data.turns)}")
    return _save(figure, file)


def probability(data: FlightData, file: Path) -> bool:
    """Draw the junction probability with its thresholds, the phases and the events."""
    if not data.probability:
        return False
    figure, axes = _figure(11.0, 3.6)
    draw_probability(axes, data, 10.0)
    return _save(figure, file)


def overview(
    data: FlightData, photo: Aerial | None, frames: Sequence[KeyFrame], file: Path
) -> bool:
    """Draw the flight on one picture: map, what was seen at junctions, probability over time.

    Of the junctions those where a turn was taken come first. Without a path or without video there
    is no overview.
    """
    turned = {m.event.count: m.event.turn for m in data.turns}
    chosen = sorted(frames, key=lambda f: f.marked.event.count not in turned)[:SHOWN]
    figure: Any = Figure(figsize=(16.0, 9.3))
    if not chosen or not draw_map(figure.add_axes((0.0, 0.262, 0.594, 0.738)), data, photo, 17.0):
        return False
    for row, frame in enumerate(sorted(chosen, key=lambda f: f.marked.event.count)):
        event, bottom = frame.marked.event, 1.0 - (row + 1) * 0.246 + row * 0.0005
        words = turn_words(turned.get(event.count))
        seen = figure.add_axes((0.6, bottom, 0.2517, 0.2405))
        _picture(seen, frame.picture, f"{event.count}  p = {event.probability:.2f}  {words}", MARK)
        made = figure.add_axes((0.8567, bottom, 0.1433, 0.2405))
        _picture(made, frame.reconstruction, "" if row else "Radon", INK)
    axes = figure.add_axes((0.045, 0.082, 0.948, 0.148))
    draw_probability(axes, data, 15.0)
    axes.spines[["top", "right"]].set_visible(False)
    return _save(figure, file, 100)


def _picture(axes: Any, picture: Any, label: str, colour: str) -> None:
    axes.imshow(picture[..., ::-1], aspect="auto", interpolation="antialiased")
    axes.set_axis_off()
    if label:
        box = {"facecolor": colour, "edgecolor": "none", "boxstyle": "round,pad=0.35"}
        style = {"color": "white", "fontsize": 16, "fontweight": "bold", "va": "top", "bbox": box}
        axes.text(0.035, 0.94, label, transform=axes.transAxes, **style)


def draw_probability(axes: Any, data: FlightData, size: float) -> None:
    """Draw the junction probability over time into `axes`; `size`: of letters, in points."""
    ends = [*(s for s, _ in data.phases[1:]), data.duration_s]
    named: set[str] = set()
    for (start, phase), end in zip(data.phases, ends, strict=True):
        label = None if phase in named or phase not in PHASES else phase
        named.add(phase)
        axes.axvspan(start, end, color=PHASES.get(phase, "#ffffff"), label=label, linewidth=0)
    raw, smooth = np.array(data.probability), np.array(data.smoothed or [(0.0, np.nan)])
    axes.plot(raw[:, 0], raw[:, 1], color=TRUTH, linewidth=0.08 * size, label="probability")
    axes.plot(smooth[:, 0], smooth[:, 1], color=PATH, linewidth=0.16 * size, label="smoothed")
    for limit in data.thresholds or ():
        axes.axhline(limit, color=INK, linewidth=0.8, linestyle="--")
    for marked in data.events:
        if marked.event.kind is EventKind.ENTERED:
            axes.axvline(marked.time_s, color=MARK, linewidth=0.12 * size)
            at, text = (marked.time_s, 1.07), {"color": "white", "fontsize": size}
            axes.plot(*at, "o", color=MARK, markersize=1.4 * size, clip_on=False, zorder=5)
            text |= {"ha": "center", "va": "center_baseline", "zorder": 6}
            axes.annotate(str(marked.event.count), at, annotation_clip=False, **text)
    axes.set(ylim=(-0.02, 1.12), xlim=(0, data.duration_s), yticks=(0, 0.5, 1))
    axes.set_xlabel("time [s]", fontsize=size, loc="left")
    axes.set_ylabel("p(junction)", fontsize=size)
    axes.tick_params(labelsize=size)
    below = -2.0 * size / 72 / (axes.get_position().height * axes.figure.get_figheight())
    place = {"loc": "upper right", "bbox_to_anchor": (1.0, below), "ncol": 9}
    axes.legend(frameon=False, fontsize=0.9 * size, handlelength=1.2, borderpad=0, **place)


def turns(data: FlightData, file: Path) -> bool:
    """Draw the map of the surface at the start of every turn, where a follower tells it."""
    begun = [m for m in data.events if m.event.kind is EventKind.TURN_STARTED]
    shown = [(m, m.surface) for m in begun if m.surface is not None][:MOST_TURNS]
    if not shown:
        return False
    rows = math.ceil(len(shown) / TURN_COLUMNS)
    figure, axes = _figure(13.0, 2.9 * rows, TURN_COLUMNS, rows)
    for one in axes.flat:
        one.set_axis_off()
    for one, (marked, surface) in zip(axes.flat, shown, strict=False):
        draw_surface(one, marked, surface)
    return _save(figure, file)


def latency(data: FlightData, file: Path) -> bool:
    """Draw the time from picture to command, and the rate of every process: how often, and when."""
    if not data.latency_ms and not data.rates:
        return False
    figure, axes = _figure(13.0, 3.4, columns=3)
    if data.latency_ms:
        p50, p99 = np.percentile(data.latency_ms, (50, 99))
        shown = np.clip(data.latency_ms, 0, max(2 * p99, 1.0))
        axes[0].hist(shown, bins=80, color=PATH)
        axes[0].set_title(f"picture to command: p50 {p50:.1f} ms, p99 {p99:.1f} ms")
    axes[0].set_xlabel("ms")
    axes[0].set_ylabel("pictures")
    fastest = max((rate for series in data.rates.values() for _, rate in series), default=1.0)
    for name, series in sorted(data.rates.items()):
        points = np.array(series)
        axes[1].hist(points[:, 1], bins=np.linspace(0, fastest + 1, 60), histtype="step")
        axes[2].plot(points[:, 0], points[:, 1], label=name, linewidth=1.2)
    axes[1].set_title("seconds at each rate")
    axes[1].set_ylabel("seconds")
    axes[1].set_xlabel("messages a second")
    axes[2].set_title("messages a second")
    axes[2].set_xlabel("time [s]")
    axes[2].legend(fontsize=7, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return _save(figure, file)


def _figure(width: float, height: float, columns: int = 1, rows: int = 1) -> tuple[Any, Any]:
    figure, axes = plt.subplots(rows, columns, figsize=(width, height), layout="constrained")
    for one in np.ravel(axes):
        one.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _save(figure: Any, file: Path, dpi: int = DPI) -> bool:
    figure.savefig(file, dpi=dpi)
    plt.close(figure)
    return True
