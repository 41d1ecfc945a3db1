"""The live terminal view of a flight: pure, from what was heard to something rich can draw."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from juncnet.messages import (
    EventKind,
    Health,
    JunctionEvent,
    NavigationState,
    Output,
    Phase,
    Pose,
    Turn,
    VehicleState,
)
from juncnet.topics import JUNCTION_EVENT
from juncnet_services.cli.braille import Canvas, Points

MAP_COLUMNS, MAP_ROWS = 56, 24
_ARROWS = "→↗↑↖←↙↓↘"
_EVENT_STYLES = {
    EventKind.APPROACHED: "yellow",
    EventKind.ENTERED: "yellow",
    EventKind.TURN_STARTED: "cyan",
    EventKind.TURN_FINISHED: "cyan",
    EventKind.LEFT: "green",
    EventKind.MISSION_FINISHED: "bold green",
}


def turn_text(turn: Turn | None) -> str:
    """Return a turn in words."""
    if turn is None:
        return "none"
    way = turn.turn or f"{turn.angle_deg:+.0f}°"
    return f"{way} at {turn.at}"


@dataclass
class Watched:
    """What was heard of a flight; the view draws it."""

    title: str
    roads: tuple[Points, ...] = ()
    """Centre lines of the world; empty: there is no map."""
    page: str = ""
    """Address of the dashboard; empty: there is none."""
    path: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    pose: Pose | None = None
    navigation: NavigationState | None = None
    vehicle: VehicleState | None = None
    health: dict[str, Health] = field(default_factory=dict[str, Health])
    restarts: dict[str, int] = field(default_factory=dict[str, int])
    events: deque[JunctionEvent] = field(default_factory=lambda: deque[JunctionEvent](maxlen=9))

    def vehicle_state(self, state: VehicleState) -> None:
        """Take the vehicle's state; the path grows by its pose."""
        self.vehicle = state
        if state.pose is None:
            return
        self.pose = state.pose
        here = (state.pose.x_m, state.pose.y_m)
        if not self.path or math.dist(self.path[-1], here) > 0.3:
            self.path.append(here)

    def standing(self) -> str:
        """Return what navigation and the vehicle last said, and which processes were restarted."""
        texts: list[str] = []
        if self.navigation is not None:
            texts.append(
                f"navigation {self.navigation.phase}: {self.navigation.reason or 'moving'}"
            )
        if self.vehicle is not None:
            reason = self.vehicle.output_reason
            texts.append(f"output {self.vehicle.output}" + (f": {reason}" if reason else ""))
        again = ", ".join(f"{name} {n} times" for name, n in self.restarts.items() if n > 0)
        return ", ".join(texts + ([f"restarted: {again}"] if again else []))


def render(watched: Watched) -> RenderableType:
    """Return the whole view."""
    left = Group(_mission(watched), _processes(watched), _events(watched))
    if not watched.roads:
        return left
    return Columns([left, _map(watched)])


def _bar(value: float, width: int = 20) -> Text:
    filled = round(value * width)
    style = "red" if value >= 0.5 else "green"
    return Text("█" * filled, style) + Text("░" * (width - filled), "dim")


def _mission(watched: Watched) -> RenderableType:
    table = Table.grid(padding=(0, 2))
    state, vehicle = watched.navigation, watched.vehicle
    if state is None:
        table.add_row("phase", Text("starting", "dim"))
    else:
        total = state.mission.finish_after
        table.add_row("phase", Text(state.phase.value, _phase_style(state.phase)), state.reason)
        table.add_row("junctions", f"{state.count}" + (f" of {total}" if total else ""))
        table.add_row("next turn", turn_text(state.next_turn))
        table.add_row("junction?", _bar(state.smoothed), f"{state.smoothed:.2f}")
    if vehicle is not None:
        style = "green" if vehicle.output is Output.PIPELINE else "bold red"
        table.add_row("output", Text(vehicle.output.value, style), vehicle.output_reason)
        speed = (vehicle.velocity or vehicle.commanded).forward_mps
        table.add_row("speed", f"{speed:.1f} m/s")
    if watched.page:
        table.add_row("dashboard", watched.page)
    return Panel(table, title=watched.title, width=64)


def _phase_style(phase: Phase) -> str:
    if phase is Phase.WAITING:
        return "dim"
    return "green" if phase in (Phase.FOLLOWING, Phase.FINISHED) else "bold yellow"


def _processes(watched: Watched) -> RenderableType:
    table = Table(box=None, padding=(0, 1), width=62)
    for column in ("process", "rate", "age ms", "p50 ms", "p99 ms", "drops", "errors", "restarts"):
        table.add_column(column, justify="left" if column == "process" else "right")
    for name, health in watched.health.items():
        restarts = watched.restarts.get(name, 0)
        table.add_row(
            name,
            f"{health.rate_hz:.1f}",
            _number(None if health.age_s is None else 1e3 * health.age_s),
            _number(health.latency_p50_ms),
            _number(health.latency_p99_ms),
            str(health.drops),
            Text(str(health.errors), "red" if health.errors else ""),
            Text(str(restarts), "red" if restarts else ""),
        )
    return Panel(table, width=64)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def event_text(event: JunctionEvent) -> str:
    """Return an event in one line, with its junction's name where the model has one."""
    turn = f"  {turn_text(event.turn)}" if event.turn else ""
    name = "" if event.label == "junction" else f" ({event.label})"
    return f"{event.index:4d}  {event.kind.value:<16} junction {event.count}{name}{turn}"


def _events(watched: Watched) -> RenderableType:
    text = Text("\n").join(Text(event_text(e), _EVENT_STYLES[e.kind]) for e in watched.events)
    return Panel(text, title=JUNCTION_EVENT.key, width=64, height=11)


def _map(watched: Watched) -> RenderableType:
    every = np.concatenate(watched.roads)
    low, high = every.min(axis=0), every.max(axis=0)
    canvas = Canvas((low[0], low[1], high[0], high[1]), MAP_COLUMNS, MAP_ROWS)
    for road in watched.roads:
        canvas.draw(road, "grey50")
    if watched.path:
        canvas.draw(np.array(watched.path), "bold cyan")
    if watched.pose is not None:
        arrow = _ARROWS[round(watched.pose.yaw_rad / (math.pi / 4)) % 8]
        canvas.mark(watched.pose.x_m, watched.pose.y_m, arrow, "bold red")
    return Panel(canvas.text(), title="map", width=MAP_COLUMNS + 4)
