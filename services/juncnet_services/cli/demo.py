"""`juncnet demo`: fly a mission on the simulated drone, show it, judge it.

Exits 0 only if the mission was flown right, 1 if not, 2 for bad arguments, 3 for a void flight (the
machine was too slow for the simulation, or the flight failed after an operator had intervened).
"""

import argparse
import importlib.util
import json
import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from rich.console import Console
from rich.live import Live

from juncnet.assets import asset_path
from juncnet.bus import Bus, Inbox
from juncnet.flight import Flight, new_flight
from juncnet.launch import connect
from juncnet.layout import SAVED, Layout, LayoutError, load_layout
from juncnet.messages import Health, Mission
from juncnet.recording import MISSING
from juncnet.simulation.routes import Route, ideal_time_s, plan_mission, route_of
from juncnet.simulation.towns import WORLD_NAMES, named_world, random_world
from juncnet.simulation.world import World
from juncnet.topics import (
    COMMAND_ACK,
    COMMAND_VELOCITY,
    JUNCTION_EVENT,
    JUNCTION_SCORE,
    NAVIGATION_STATE,
    SERVICES,
    SIMULATOR_TRUTH,
    VEHICLE_STATE,
    health_topic,
)
from juncnet_services.cli.judge import MIN_REAL_TIME_FACTOR, Judge, Plan, Summary
from juncnet_services.cli.ranges import positive, whole
from juncnet_services.cli.supervise import Supervisor
from juncnet_services.cli.view import Watched, event_text, render
from juncnet_services.dashboard.service import Config as PageConfig
from juncnet_services.dashboard.service import page_url
from juncnet_services.junction_navigation.missions import load_mission

LAYOUTS = {"copter": "local", "rover": "rover"}
CRUISE_MPS = {"copter": 3.0, "rover": 2.0}
YAW_RATE_RADPS = 1.0
START_S = 30.0
"""Time allowed from the start of the processes to the first motion."""
PATIENCE = 2.0
"""A flight ends unfinished after this many times its ideal time."""
AFTER_FINISH_S = 1.0
DASHBOARD, RECORDER = "dashboard", "recorder"
EXIT_CODES = {"flown_right": 0, "failed": 1, "void": 3}
VOID_REMEDY = (
    "this machine was too slow, or too busy, to simulate: end what else runs, or let the camera "
    "be smaller: --set simulator.width=1280 --set simulator.height=720"
)


@dataclass(frozen=True)
class Setup:
    """What to fly, where."""

    world: World
    route: Route
    vehicle: str
    layout: str
    settings: tuple[str, ...]

    @property
    def plan(self) -> Plan:
        """What the judge holds the flight against."""
        cruise = CRUISE_MPS[self.vehicle]
        ideal_s = ideal_time_s(self.route.length_m, cruise, self.route.turns, YAW_RATE_RADPS)
        return Plan(self.route.path, ideal_s)


def prepare(
    vehicle: str,
    world_name: str | None = None,
    seed: int = 1,
    mission: Mission | None = None,
    settings: Sequence[str] = (),
) -> Setup:
    """Return the setup of a flight; without a mission one is planned from the seed.

    Raises:
        ValueError: there is no such world, or the mission cannot be driven in it.
    """
    world = named_world(world_name) if world_name else random_world(seed)
    where = f'simulator.world="{world_name}"' if world_name else f"simulator.seed={seed}"
    route = plan_mission(world, seed) if mission is None else route_of(world, mission)
    return Setup(world, route, vehicle, LAYOUTS[vehicle], (where, *settings))


def mission_toml(mission: Mission) -> str:
    """Return a mission as a TOML inline table."""

    def table(fields: dict[str, object]) -> str:
        return "{" + ", ".join(f"{k} = {value(v)}" for k, v in fields.items()) + "}"

    def value(item: object) -> str:
        if isinstance(item, list):
            return (
                "[" + ", ".join(table(row) for row in cast("list[dict[str, object]]", item)) + "]"
            )
        return json.dumps(item)

    return table(mission.model_dump(mode="json", exclude_none=True))


class Demo:
    """One flight from start to summary; a context, so that its processes always end."""

    def __init__(self, setup: Setup, beside: Sequence[str] = ()):
        """Check the layout and make the flight's directory; `beside`: optional processes.

        Raises:
            LayoutError: an option is wrong.
        """
        self.setup = setup
        path = asset_path(setup.layout, "layouts", ".toml")
        draft = load_layout(path, setup.settings).beside(*beside)
        self.flight: Flight = new_flight(draft.launch.robot, draft.processes)
        directory = self.flight.directory
        self.settings = (
            f'launch.state_dir="{directory}/state"',
            f"junction_navigation.mission={mission_toml(setup.route.mission)}",
            *setup.settings,
        )
        try:
            self.layout: Layout = load_layout(path, self.settings).beside(*beside)
            self.layout.validate_all()
            self.layout.save(directory / SAVED)
        except BaseException:  # interrupted too
            self.discard()
            raise
        self.supervisor = Supervisor(directory)
        self.judge = Judge(setup.plan, setup.world.name, setup.vehicle)
        self.watched = Watched(
            f"{setup.world.name}, {setup.vehicle}: {setup.route.mission.name}",
            tuple(road.centre for road in setup.world.roads.values()),
        )
        if DASHBOARD in beside:
            self.watched.page = page_url(directory, self.layout.section(DASHBOARD, PageConfig))

    def __enter__(self) -> "Demo":
        arguments = ["--layout", str(self.layout.path), "--flight-dir", str(self.flight.directory)]
        for setting in self.settings:
            arguments += ["--set", setting]
        try:
            self.supervisor.start(self.layout.processes, arguments, foreground=True)
        except BaseException:  # interrupted too: what has started is ended
            self.supervisor.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.supervisor.stop()

    def discard(self) -> None:
        """Remove the flight's directory with its logs."""
        shutil.rmtree(self.flight.directory, ignore_errors=True)

    def fly(self, limit_s: float | None, live: Live | None, verbose: bool) -> Summary:
        """Watch the flight until its mission ends or its time is up, and return the summary."""
        with connect(self.flight.directory, timeout_s=START_S) as bus:
            ears = _Ears(bus)
            deadline = time.monotonic() + (limit_s or START_S + PATIENCE * self.setup.plan.ideal_s)
            drawn = 0.0
            while time.monotonic() < deadline:
                bus.wait(0.1)
                self._hear(ears, verbose)
                if self.judge.finished:
                    deadline = min(deadline, time.monotonic() + AFTER_FINISH_S)
                if live is not None and time.monotonic() - drawn > 0.2:
                    drawn = time.monotonic()
                    self.watched.restarts = self.supervisor.restarts()
                    live.update(render(self.watched), refresh=True)
        self.watched.restarts = self.supervisor.restarts()
        return self.judge.summary(self.watched.standing())

    def _hear(self, ears: "_Ears", verbose: bool) -> None:
        for _, truth in ears.truth.drain():
            self.judge.truth(truth)
        for _, score in ears.score.drain():
            self.judge.score(score)
        for _, command in ears.command.drain():
            self.judge.command(command)
        for _, ack in ears.ack.drain():
            self.judge.answer(ack)
        for _, event in ears.event.drain():
            self.judge.event(event)
            self.watched.events.append(event)
            if verbose:
                print(event_text(event), file=sys.stderr, flush=True)
        for _, state in ears.vehicle.drain():
            self.watched.vehicle_state(state)
        for _, state in ears.navigation.drain():
            self.watched.navigation = state
        for name, inbox in ears.health.items():
            for _, health in inbox.drain():
                self.watched.health[name] = health


class _Ears:
    """Everything of a flight that a viewer listens to."""

    def __init__(self, bus: Bus):
        self.truth = bus.subscribe(SIMULATOR_TRUTH, 500)
        self.score = bus.subscribe(JUNCTION_SCORE, 500)
        self.command = bus.subscribe(COMMAND_VELOCITY, 500)
        self.ack = bus.subscribe(COMMAND_ACK, 500)
        self.event = bus.subscribe(JUNCTION_EVENT, 500)
        self.vehicle = bus.subscribe(VEHICLE_STATE, 100)
        self.navigation = bus.subscribe(NAVIGATION_STATE)
        names = ("simulator", *SERVICES)
        self.health: dict[str, Inbox[Health]] = {
            name: bus.subscribe(health_topic(name)) for name in names
        }


def summary_text(summary: Summary) -> str:
    """Return the summary for a person."""
    s = summary
    p50 = "-" if s.latency_p50_ms is None else f"{s.latency_p50_ms:.1f}"
    p99 = "-" if s.latency_p99_ms is None else f"{s.latency_p99_ms:.1f}"
    rows = (
        ("junctions", f"{s.junctions_counted} counted, {s.junctions_true} passed"),
        ("turns", f"{s.turns_taken} of {s.turns_planned} into the right road"),
        (
            "on the road",
            f"{100 * s.on_road:.1f} % of the time, at most {s.off_road_max_m:.2f} m off, "
            f"{s.centre_rms_m:.2f} m rms from its centre",
        ),
        ("collisions", str(s.collisions)),
        ("time", f"{s.time_s:.1f} s (ideal {s.ideal_time_s:.1f} s)"),
        ("rate", f"{s.fps:.1f} FPS; picture to command {p50} ms p50, {p99} ms p99"),
        (
            "simulation",
            f"real-time factor {s.real_time_factor:.2f}, "
            f"{s.real_time_factor_lowest:.2f} in the worst second",
        ),
    )
    lines = [f"  {name:<12} {text}" for name, text in rows]
    if s.real_time_factor < MIN_REAL_TIME_FACTOR:
        lines.append(f"  {'remedy':<12} {VOID_REMEDY}")
    verdict = {"flown_right": "FLOWN RIGHT", "failed": "NOT FLOWN RIGHT", "void": "VOID"}
    reasons = f": {'; '.join(s.reasons)}" if s.reasons else ""
    return "\n".join([f"{verdict[s.verdict]}: {s.world}, {s.vehicle}{reasons}", *lines])


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(prog="juncnet demo", description=__doc__)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--world", choices=WORLD_NAMES, help="a named world")
    where.add_argument("--seed", type=whole(0), default=1, help="a random world (default 1)")
    parser.add_argument("--mission", type=Path, help="TOML or JSON file; default: planned")
    parser.add_argument("--vehicle", choices=tuple(LAYOUTS), default="copter")
    parser.add_argument("--for", type=positive, dest="limit", metavar="SECONDS", help="end after")
    parser.add_argument("--headless", action="store_true", help="no live view; events as lines")
    parser.add_argument("--json", action="store_true", help="print the summary as one object")
    parser.add_argument(
        "--dashboard",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="a page to watch and command the flight; its address is printed",
    )
    parser.add_argument(
        "--record", action="store_true", help="record the flight to ./recordings (extra [record])"
    )
    parser.add_argument("--keep", action="store_true", help="keep the flight's logs")
    parser.add_argument(
        "--set", action="append", default=[], metavar="SECTION.OPTION=VALUE", help="repeatable"
    )
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Fly and print the summary."""
    options = arguments(argv)
    if options.record and importlib.util.find_spec("mcap") is None:
        print(f"juncnet demo: {MISSING}", file=sys.stderr)
        return 2
    try:
        mission = load_mission(options.mission) if options.mission else None
        setup = prepare(options.vehicle, options.world, options.seed, mission, options.set)
        asked = {DASHBOARD: options.dashboard, RECORDER: options.record}
        demo = Demo(setup, [name for name, wanted in asked.items() if wanted])
    except (LayoutError, ValueError, OSError) as error:
        print(f"juncnet demo: {error}", file=sys.stderr)
        return 2
    console = Console(stderr=True)
    if demo.watched.page:
        print(f"dashboard: {demo.watched.page}", file=sys.stderr, flush=True)
    try:
        with demo:
            if options.headless or not console.is_terminal:
                summary = demo.fly(options.limit, None, verbose=True)
            else:
                with Live(console=console, auto_refresh=False, screen=True) as live:
                    summary = demo.fly(options.limit, live, verbose=False)
    finally:
        if not options.keep:
            demo.discard()
    print(summary.model_dump_json(indent=2) if options.json else summary_text(summary))
    if options.keep:
        print(f"logs: {demo.flight.directory}", file=sys.stderr)
    return EXIT_CODES[summary.verdict]
