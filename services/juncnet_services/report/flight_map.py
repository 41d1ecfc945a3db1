"""The map of a flight: the path over the world, junctions by number and what was done there."""

from typing import Any

import numpy as np
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from juncnet.messages import EventKind, Turn
from juncnet_services.report.aerial import Aerial
from juncnet_services.report.flight_data import FlightData

PATH, MARK, INK, PAPER = "#1565c0", "#c62828", "#1b1b1b", "#ffffff"
OVER_PHOTO = "#29b6f6"
MARGIN_M, BAR_M, HEADING_M = 16.0, 20.0, 2.0
F64 = NDArray[np.float64]


def draw_map(axes: Any, data: FlightData, photo: Aerial | None, size: float = 11.0) -> bool:
    """Draw where the vehicle went; return whether that is known.

    By the ground truth where there is one, and then over `photo`; else by the vehicle's own pose;
    else by GPS. `size`: of letters, in points.
    """
    track, places, name = _track(data)
    if len(track) < 2:
        return False
    colour = PATH
    if photo is not None and data.truths:
        colour = OVER_PHOTO
        axes.imshow(photo.picture, extent=photo.extent, interpolation="antialiased", zorder=0)
        axes.set_facecolor(photo.beyond)
    casing = [withStroke(linewidth=size * 0.6, foreground=PAPER)]
    axes.plot(*track.T, color=colour, linewidth=size * 0.36, path_effects=casing, zorder=3)
    axes.plot(*track[0], "o", color=PAPER, markeredgecolor=INK, markersize=size * 0.75, zorder=4)
    _arrow(axes, track, colour, size)
    _junctions(axes, data, places, size)
    if name == "GPS":
        axes.set(xlabel="longitude [°]", ylabel="latitude [°]")
    else:
        axes.set_aspect("equal")
        _frame(axes, track)
    return True


def turn_words(turn: Turn | None) -> str:
    """Return what a turn is called: left, right, straight, or its angle."""
    if turn is None:
        return ""
    return turn.turn or f"{turn.angle_deg:+.0f}°"


def _track(data: FlightData) -> tuple[F64, list[tuple[float, float] | None], str]:
    """Return the path (N, 2), the place of every event, and by what they are known."""
    if data.truths:
        times = np.array([s for s, _ in data.truths])
        points = np.array([(t.pose.x_m, t.pose.y_m) for _, t in data.truths])
        rows = np.searchsorted(times, [m.time_s for m in data.events])
        places: list[tuple[float, float] | None] = [
            (float(x), float(y)) for x, y in points[np.minimum(rows, len(times) - 1)]
        ]
        return points, places, "path"
    if data.path:
        return np.array(data.path)[:, 1:], [m.place for m in data.events], "path"
    fixes = np.array(data.fixes).reshape(-1, 3)
    return fixes[:, 2:0:-1], [None] * len(data.events), "GPS"


def _junctions(
    axes: Any, data: FlightData, places: list[tuple[float, float] | None], size: float
) -> None:
    turned = {m.event.count: m.event.turn for m in data.turns}
    words = [withStroke(linewidth=size * 0.3, foreground=INK)]
    for marked, where in zip(data.events, places, strict=True):
        if marked.event.kind is not EventKind.ENTERED or where is None:
            continue
        axes.plot(*where, "o", color=MARK, markeredgecolor=PAPER, markersize=size * 1.6, zorder=5)
        text = {"color": PAPER, "fontsize": size, "fontweight": "bold", "zorder": 6}
        axes.annotate(str(marked.event.count), where, ha="center", va="center_baseline", **text)
        axes.annotate(
            turn_words(turned.get(marked.event.count)),
            where,
            xytext=(size, -size * 0.3),
            textcoords="offset points",
            path_effects=words,
            **text,
        )


def _arrow(axes: Any, track: F64, colour: str, size: float) -> None:
    """Point where the vehicle was heading at the end."""
    far = np.flatnonzero(np.hypot(*(track - track[-1]).T) > HEADING_M)
    along = track[-1] - track[far[-1] if len(far) else 0]
    turned = np.degrees(np.arctan2(along[1], along[0])) - 90
    style = {"markersize": size * 1.6, "color": colour, "markeredgecolor": PAPER}
    axes.plot(*track[-1], marker=(3, 0, turned), markeredgewidth=size * 0.12, zorder=4, **style)


def _frame(axes: Any, track: F64) -> None:
    """Show the path with a margin all around, and how long 20 m are."""
    low, high = track.min(axis=0) - MARGIN_M, track.max(axis=0) + MARGIN_M
    box = axes.get_window_extent()
    scale = max((high - low) / (box.width, box.height))
    half = np.array([box.width, box.height]) * scale / 2
    (x_min, y_min), (x_max, y_max) = (low + high) / 2 - half, (low + high) / 2 + half
    axes.set(xlim=(x_min, x_max), ylim=(y_min, y_max), xticks=[], yticks=[])
    x, y = x_min + 0.03 * (x_max - x_min), y_min + 0.04 * (y_max - y_min)
    casing = [withStroke(linewidth=5, foreground=PAPER)]
    axes.plot([x, x + BAR_M], [y, y], color=INK, linewidth=2.5, path_effects=casing, zorder=6)
    text = {"color": INK, "path_effects": casing, "fontsize": 10, "zorder": 6}
    axes.annotate(f"{BAR_M:.0f} m", (x, y), (0, 5), textcoords="offset points", **text)
