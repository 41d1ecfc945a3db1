"""Drives through a simulated world as somebody with a camera would film them, and what they show.

They stand in for a user's footage: to try the way from videos to a model without a drone.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet.learning.footage.intervals import Interval
from juncnet.simulation.roads import RoadNetwork, arc_lengths, arm_ends, resample, reverse_arm
from juncnet.simulation.routes import SHARPEST_RAD, ways
from juncnet.simulation.truth import GroundTruth
from juncnet.simulation.world import World, wrap

Points = NDArray[np.float64]

CORNER_M = 4.0
"""Turns are rounded by a moving average over twice this length."""
SWAY_M = 18.0
"""Length over which lateral and heading errors change."""
UNSURE = "transition"
SHORTEST_S = 0.3
"""Shorter intervals are left out, as a person would."""


@dataclass(frozen=True)
class Drive:
    """A way through the world: on directed road `arriving`, and on along `leaving` if named."""

    site: str
    arriving: int
    leaving: int | None
    before_m: float
    """Way before the junction's node, or before the end of the road."""
    after_m: float = 0.0


def junction_drives(world: World, node: int, before_m: float, after_m: float) -> list[Drive]:
    """Return a drive through a junction from each of its arms, each on by another way."""
    network = RoadNetwork(world)
    drives: list[Drive] = []
    for arm in network.junctions[node].arms:
        arriving = reverse_arm(arm.id)
        angles = {a: x for a, x in ways(network, arriving).items() if abs(x) <= SHARPEST_RAD}
        onward = sorted(angles, key=lambda a: abs(angles[a]))
        drives += [
            Drive(f"junction-{node}", arriving, way, before_m, after_m) for way in onward[:1]
        ]
    return drives


def road_drives(world: World, camera: CameraGeometry, length_m: float) -> list[Drive]:
    """Return a drive along every road, both ways, that ends before a junction comes into view."""
    network = RoadNetwork(world)
    clear_m = camera.band.d_far_m * 1.5
    drives: list[Drive] = []
    for arm in sorted(2 * road + side for road in world.roads for side in (0, 1)):
        end = arm_ends(world, arm)[1]
        margin = network.setback_m(reverse_arm(arm)) + clear_m if end in network.junctions else 2.0
        start = arm_ends(world, arm)[0]
        behind = network.setback_m(arm) + 2.0 if start in network.junctions else 2.0
        free_m = network.lengths[arm // 2] - margin - behind
        if free_m >= length_m:
            drives.append(Drive(f"road-{arm // 2}", arm, None, margin + length_m, -margin))
    return drives


def path_of(world: World, drive: Drive) -> Points:
    """Return the way of a drive, (N, 2) metres, points 0.25 m apart, turns rounded."""
    arriving = _centre(world, drive.arriving)
    points = _last(arriving, drive.before_m)
    if drive.leaving is not None:
        onward = _centre(world, drive.leaving)
        points = np.concatenate([points, _first(onward, drive.after_m)[1:]])
    elif drive.after_m < 0:
        points = _first(points, float(arc_lengths(points)[-1]) + drive.after_m)
    points = resample(points, 0.25)
    return _rounded(points, round(CORNER_M / 0.25))


def poses(path: Points, speed_mps: float, fps: float, rng: np.random.Generator) -> Points:
    """Return where the camera is at each frame, (N, 3): x, y, yaw, with the sway of a robot.

    The lateral error deviates by 0.35 m, the heading by 3 degrees, both slowly.
    """
    along = arc_lengths(path)
    wanted = np.arange(0.0, along[-1], speed_mps / fps)
    x, y = np.interp(wanted, along, path[:, 0]), np.interp(wanted, along, path[:, 1])
    steps = np.diff(path, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    yaw = np.interp(wanted, (along[1:] + along[:-1]) / 2, heading)
    side = 0.35 * _sway(wanted, rng)
    error = math.radians(3.0) * _sway(wanted, rng)
    return np.stack([x - side * np.sin(yaw), y + side * np.cos(yaw), yaw + error], axis=1)


def labels_of(truth: GroundTruth, where: Points, camera: CameraGeometry, drive: Drive) -> list[str]:
    """Return what each pose (N, 3) of a drive shows: `none`, `junction` or `transition`.

    Another junction than the one that the drive is about is *transition*.
    """
    node = arm_ends(truth.world, drive.arriving)[1]
    labels: list[str] = []
    for x_m, y_m, yaw in where.tolist():
        label: str = truth.label(x_m, y_m, wrap(yaw), camera)
        if label == "junction":
            ahead = truth.mouth_ahead(x_m, y_m, wrap(yaw))
            label = label if ahead is not None and ahead[1] == node else UNSURE
        labels.append(label)
    return labels


def intervals_of(clip: str, site: str, labels: Sequence[str], fps: float) -> list[Interval]:
    """Return the intervals of a clip whose frames show `labels`; what is unsure is left out."""
    found: list[Interval] = []
    start = 0
    for index in range(1, len(labels) + 1):
        if index == len(labels) or labels[index] != labels[start]:
            if labels[start] != UNSURE and index - start >= SHORTEST_S * fps:
                found.append(Interval(clip, start / fps, index / fps, labels[start], site))
            start = index
    return found


def _centre(world: World, arm: int) -> Points:
    centre = world.roads[arm // 2].centre
    return centre if arm % 2 == 0 else centre[::-1]


def _first(points: Points, length_m: float) -> Points:
    along = arc_lengths(points)
    end = float(np.clip(length_m, 1.0, along[-1]))
    inner = points[(along < end)]
    last = [np.interp(end, along, points[:, k]) for k in (0, 1)]
    return np.concatenate([inner, [last]])


def _last(points: Points, length_m: float) -> Points:
    return _first(points[::-1], length_m)[::-1]


def _rounded(points: Points, reach: int) -> Points:
    """Return points averaged over `reach` neighbours on either side, fewer near the ends."""
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(points, axis=0)])
    index = np.arange(len(points))
    span = np.minimum(np.minimum(index, len(points) - 1 - index), reach)
    return (sums[index + span + 1] - sums[index - span]) / (2 * span + 1)[:, None]


def _sway(along_m: Points, rng: np.random.Generator) -> Points:
    """Return a slow random curve over a way, of mean 0 and deviation about 1."""
    waves = rng.normal(0, 0.5, (4, 2))
    lengths = SWAY_M * rng.uniform(0.6, 2.5, 4)
    phase = 2 * math.pi * along_m[None] / lengths[:, None]
    curve = waves[:, :1] * np.sin(phase) + waves[:, 1:] * np.cos(phase)
    return np.asarray(curve.sum(axis=0), np.float64)
