"""The plots of a report, as PNG files. Matplotlib draws them."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from juncnet.messages import EventKind
from juncnet.simulation.world import World
from juncnet_services.report.flight_data import FlightData

mpl.use("Agg")
import matplotlib.pyplot as plt

PATH, TRUTH, MARK, ROAD, INK = "#1565c0", "#9e9e9e", "#c62828", "#d7d9db", "#333333"
PHASES = {
    "following": "#e3f2fd",
    "approaching": "#fff3c4",
    "crossing": "#dcedc8",
    "turning": "#ffccbc",
    "aligning": "#e1bee7",
    "waiting": "#eeeeee",
    "finished": "#ffffff",
}
DPI = 110


def draw_all(data: FlightData, world: World | None, folder: Path) -> dict[str, Path]:
    """Draw every plot that the data allow; return the files by name."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {name: folder / f"{name}.png" for name in ("path", "probability", "latency")}
    drawn = {
        "path": path(data, world, files["path"]),
        "probability": probability(data, files["probability"]),
        "latency": latency(data, files["latency"]),
    }
    return {name: files[name] for name, done in drawn.items() if done}


def path(data: FlightData, world: World | None, file: Path) -> bool:
    """Draw where the vehicle went, over the map where there is one: the paper's Fig. 1."""
    if not data.path and not data.fixes and not data.truths:
        return False
    figure, axes = _figure(8.0, 6.4)
    if world is not None:
        for road in world.roads.values():
            axes.plot(road.centre[:, 0], road.centre[:, 1], color=ROAD, linewidth=7, zorder=1)
    if data.truths:
        pose = np.array([(t.pose.x_m, t.pose.y_m) for _, t in data.truths])
        axes.plot(pose[:, 0], pose[:, 1], color=PATH, linewidth=2, label="path", zorder=3)
        place = _place_by_truth(data)
    elif data.path:
        points = np.array(data.path)
        axes.plot(points[:, 1], points[:, 2], color=PATH, linewidth=2, label="path", zorder=3)
        place = {id(m): m.place for m in data.events}
    else:
        points = np.array(data.fixes)
        axes.plot(points[:, 2], points[:, 1], color=PATH, linewidth=2, label="GPS", zorder=3)
        place = {}
    turned = {m.event.count: m.event.turn for m in data.turns}
    for marked in data.events:
        where = place.get(id(marked))
        if marked.event.kind is not EventKind.ENTERED or where is None:
            continue
        count = marked.event.count
        turn = turned.get(count)
        what = "" if turn is None else f" {turn.turn or f'{turn.angle_deg:+.0f}°'}"
        axes.plot(*where, "o", color=MARK, markersize=17, zorder=4)
        axes.annotate(str(count), where, color="white", ha="center", va="center", zorder=5)
        axes.annotate(what, where, xytext=(11, -3), textcoords="offset points", zorder=5)
    axes.set_aspect("equal" if not data.fixes or data.path else "auto")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(f"junctions counted: {data.counted}, turns taken: {len(turned)}")
    return _save(figure, file)


def _place_by_truth(data: FlightData) -> dict[int, tuple[float, float] | None]:
    times = np.array([s for s, _ in data.truths])
    places: dict[int, tuple[float, float] | None] = {}
    for marked in data.events:
        index = min(int(np.searchsorted(times, marked.time_s)), len(times) - 1)
        pose = data.truths[index][1].pose
        places[id(marked)] = (pose.x_m, pose.y_m)
    return places


def probability(data: FlightData, file: Path) -> bool:
    """Draw the junction probability with its thresholds, the phases and the events."""
    if not data.probability:
        return False
    figure, axes = _figure(11.0, 3.6)
    ends = [*(s for s, _ in data.phases[1:]), data.duration_s]
    named: set[str] = set()
    for (start, phase), end in zip(data.phases, ends, strict=True):
        label = None if phase in named else phase
        named.add(phase)
        axes.axvspan(start, end, color=PHASES.get(phase, "#ffffff"), label=label, linewidth=0)
    raw, smooth = np.array(data.probability), np.array(data.smoothed or [(0.0, np.nan)])
    axes.plot(raw[:, 0], raw[:, 1], color=TRUTH, linewidth=0.7, label="probability")
    axes.plot(smooth[:, 0], smooth[:, 1], color=PATH, linewidth=1.6, label="smoothed")
    for limit in data.thresholds or ():
        axes.axhline(limit, color=INK, linewidth=0.8, linestyle="--")
    for marked in data.events:
        if marked.event.kind is EventKind.ENTERED:
            axes.axvline(marked.time_s, color=MARK, linewidth=1.2)
            at = (marked.time_s, 1.07)
            axes.plot(*at, "o", color=MARK, markersize=13, clip_on=False)
            axes.annotate(str(marked.event.count), at, color="white", ha="center", va="center")
    axes.set_ylim(-0.02, 1.12)
    axes.set_xlim(0, data.duration_s)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("p(junction)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncol=9, frameon=False, fontsize=8)
    return _save(figure, file)


def latency(data: FlightData, file: Path) -> bool:
    """Draw the time from picture to command, and the rate of every process."""
    if not data.latency_ms and not data.rates:
        return False
    figure, axes = _figure(11.0, 3.4, columns=2)
    if data.latency_ms:
        p50, p99 = np.percentile(data.latency_ms, (50, 99))
        shown = np.clip(data.latency_ms, 0, max(2 * p99, 1.0))
        axes[0].hist(shown, bins=80, color=PATH)
        axes[0].set_title(f"picture to command: p50 {p50:.1f} ms, p99 {p99:.1f} ms")
    axes[0].set_xlabel("ms")
    for name, series in sorted(data.rates.items()):
        points = np.array(series)
        axes[1].plot(points[:, 0], points[:, 1], label=name, linewidth=1.2)
    axes[1].set_title("messages a second")
    axes[1].set_xlabel("time [s]")
    axes[1].legend(fontsize=7, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return _save(figure, file)


def _figure(width: float, height: float, columns: int = 1) -> tuple[Any, Any]:
    figure, axes = plt.subplots(1, columns, figsize=(width, height), layout="constrained")
    for one in np.atleast_1d(axes):
        one.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _save(figure: Any, file: Path) -> bool:
    figure.savefig(file, dpi=DPI)
    plt.close(figure)
    return True
