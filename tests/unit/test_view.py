"""The terminal view shows what was heard: events, processes, and the path on the map."""

import numpy as np
from rich.console import Console

from juncnet.messages import (
    Capabilities,
    EventKind,
    Health,
    JunctionEvent,
    Mission,
    NavigationState,
    Output,
    Phase,
    Pose,
    Turn,
    VehicleState,
)
from juncnet_services.cli.braille import Canvas
from juncnet_services.cli.view import Watched, render
from scenes import stamp


def text(watched: Watched) -> str:
    console = Console(width=140, height=60, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    with console.file:
        console.print(render(watched))
        return console.export_text()


def test_a_diagonal_line_fills_its_dots() -> None:
    canvas = Canvas((0, 0, 7, 7), columns=4, rows=2)
    canvas.draw(np.array([[i, i] for i in range(8)], float), "")
    assert str(canvas.text()).splitlines() == ["  \u2860\u280a", "\u2860\u280a  "]


def test_everything_heard_is_shown() -> None:
    watched = Watched("town, copter", roads=(np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 40.0]]),))
    mission = Mission(turns=(Turn(at=2, turn="left"),), finish_after=4)
    watched.navigation = NavigationState(
        header=None,
        flight="f",
        phase=Phase.APPROACHING,
        count=2,
        mission=mission,
        next_turn=mission.turns[0],
        smoothed=0.75,
    )
    watched.vehicle_state(
        VehicleState(
            at=stamp(),
            capabilities=Capabilities(),
            pose=Pose(x_m=10, y_m=0),
            output=Output.STOPPED,
            output_reason="stopped by operator",
        )
    )
    event = EventKind.APPROACHED
    watched.events.append(
        JunctionEvent(header=stamp(), flight="f", index=7, kind=event, count=2, probability=0.9)
    )
    watched.health["road_following"] = Health(
        service="road_following", at=stamp(), flight="f", pid=1, rate_hz=24.9, errors=3
    )
    watched.restarts["road_following"] = 5
    standing = watched.standing()
    for part in ("approaching", "output stopped: stopped by operator", "road_following 5 times"):
        assert part in standing, part
    shown = text(watched)
    for part in ("approaching", "2 of 4", "left at 2", "0.75", "stopped by operator", "24.9"):
        assert part in shown, part
    assert "approached" in shown
    assert "→" in shown  # the robot on the map, heading east


def test_nothing_heard_yet_is_shown_too() -> None:
    assert "starting" in text(Watched("town"))
    assert Watched("town").standing() == ""
