"""A picture of a flight: what the camera saw before a junction, and the path flown over the map."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet.messages import EventKind, JunctionEvent, SimulatorTruth
from juncnet.simulation.render import Renderer
from juncnet.simulation.world import World
from juncnet_services.cli.judge import Summary
from juncnet_services.cli.view import turn_text

Picture = NDArray[np.uint8]
"""(H, W, 3), blue first."""

HEIGHT = 540
MARGIN_PX = 40
PAPER, ROAD, PATH, MARK, INK = (
    (250, 250, 248),
    (206, 208, 210),
    (190, 90, 20),
    (40, 60, 210),
    (60, 60, 60),
)
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def flight_picture(
    world: World,
    camera: CameraGeometry,
    truths: Sequence[SimulatorTruth],
    events: Sequence[JunctionEvent],
    summary: Summary,
) -> Picture:
    """Return the picture of a flight, (540, 960 + about 540, 3).

    Left: the camera's picture at the first junction where a turn was planned. Right: the map, the
    path, and at every junction its number and what was done there.
    """
    return np.hstack([_camera(world, camera, truths, events), _map(world, truths, events, summary)])


def _camera(
    world: World,
    geometry: CameraGeometry,
    truths: Sequence[SimulatorTruth],
    events: Sequence[JunctionEvent],
) -> Picture:
    width = round(HEIGHT * 16 / 9)
    turned = {e.count: e.turn for e in events if e.kind is EventKind.TURN_STARTED}
    seen = [e for e in events if e.kind is EventKind.APPROACHED]
    shown = next((e for e in seen if e.count in turned), seen[0] if seen else None)
    after_ns = 0 if shown is None else shown.header.time_ns
    truth = min(truths, key=lambda t: abs(t.at.time_ns - after_ns))
    pose = truth.pose
    flat = Renderer(world, width, HEIGHT, geometry).render_i420(
        pose.x_m, pose.y_m, pose.yaw_rad, roll_rad=pose.roll_rad, pitch_rad=pose.pitch_rad
    )
    planes = flat.reshape(HEIGHT * 3 // 2, width)
    picture = np.asarray(cv2.cvtColor(planes, cv2.COLOR_YUV2BGR_I420), np.uint8)
    if shown is not None:
        turn = turned.get(shown.count)
        what = f", {turn_text(turn)}" if turn else ""
        _label(picture, f"junction {shown.count}: p = {shown.probability:.2f}{what}")
    return picture


def _label(picture: Picture, text: str) -> None:
    (width, height), _ = cv2.getTextSize(text, _FONT, 0.8, 2)
    cv2.rectangle(picture, (12, 12), (28 + width, 36 + height), MARK, cv2.FILLED)
    cv2.putText(picture, text, (20, 24 + height), _FONT, 0.8, (255, 255, 255), 2, cv2.LINE_AA)


def _map(
    world: World,
    truths: Sequence[SimulatorTruth],
    events: Sequence[JunctionEvent],
    summary: Summary,
) -> Picture:
    x0, y0, x1, y1 = world.bounds
    scale = (HEIGHT - 2 * MARGIN_PX) / max(y1 - y0, 1.0)
    width = max(round((x1 - x0) * scale) + 2 * MARGIN_PX, 360)
    paper = np.full((HEIGHT, width, 3), PAPER, np.uint8)

    def at(points: NDArray[np.float64]) -> NDArray[np.int32]:
        columns = MARGIN_PX + (points[:, 0] - x0) * scale
        rows = HEIGHT - MARGIN_PX - (points[:, 1] - y0) * scale
        return np.rint(np.stack([columns, rows], axis=1) * 16).astype(np.int32)

    for road in world.roads.values():
        thickness = max(2, round(road.width_m * scale))
        cv2.polylines(paper, [at(road.centre)], False, ROAD, thickness, cv2.LINE_AA, 4)
    path = np.array([[t.pose.x_m, t.pose.y_m] for t in truths])
    cv2.polylines(paper, [at(path)], False, PATH, 3, cv2.LINE_AA, 4)
    turned = {e.count: e.turn for e in events if e.kind is EventKind.TURN_STARTED}
    for event in events:
        if event.kind is not EventKind.ENTERED:
            continue
        truth = min(truths, key=lambda t: abs(t.at.time_ns - event.header.time_ns))
        (place,) = at(np.array([[truth.pose.x_m, truth.pose.y_m]])) // 16
        turn = turned.get(event.count)
        _junction(
            paper, (int(place[0]), int(place[1])), event.count, turn_text(turn) if turn else ""
        )
    _arrow(paper, at(path[-1:])[0] // 16, truths[-1].pose.yaw_rad)
    line = f"{summary.junctions_counted} of {summary.junctions_true} junctions counted, "
    line += f"{summary.turns_taken} of {summary.turns_planned} ways right"
    cv2.putText(paper, line, (MARGIN_PX, 24), _FONT, 0.5, INK, 1, cv2.LINE_AA)
    return paper


def _junction(paper: Picture, place: tuple[int, int], count: int, text: str) -> None:
    cv2.circle(paper, place, 11, MARK, cv2.FILLED, cv2.LINE_AA)
    x, y = place[0] - 5 * len(str(count)), place[1] + 5
    cv2.putText(paper, str(count), (x, y), _FONT, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    words = text.split(" at ")[0]
    cv2.putText(paper, words, (place[0] + 14, place[1] + 5), _FONT, 0.45, INK, 1, cv2.LINE_AA)


def _arrow(paper: Picture, place: NDArray[np.int32], yaw_rad: float) -> None:
    corners = [(12.0, 0.0), (-8.0, 7.0), (-8.0, -7.0)]
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    points = [(place[0] + c * x - s * y, place[1] - s * x - c * y) for x, y in corners]
    cv2.fillPoly(paper, [np.rint(points).astype(np.int32)], PATH, cv2.LINE_AA)
