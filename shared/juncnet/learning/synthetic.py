"""Labelled pictures from simulated worlds, along the roads that a robot drives.

    python -m juncnet.learning.synthetic --first-seed 1000000 --worlds 200 --out train.npz

Seeds from 1,000,000 on are for training, from 2,000,000 on for validation during training, from
3,000,000 on for the figures in the model card; seeds below 1,000,000 are for flying.
"""

import argparse
import dataclasses
import math
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.camera import TRANSITION, CameraGeometry
from juncnet.learning.samples import LABELS, Samples
from juncnet.shrink import shrink
from juncnet.simulation.ground import GroundTexture
from juncnet.simulation.palettes import jitter, palette_named
from juncnet.simulation.render import Renderer
from juncnet.simulation.roads import RoadNetwork, arm_ends, reverse_arm
from juncnet.simulation.towns import random_world
from juncnet.simulation.truth import GroundTruth
from juncnet.simulation.world import Style, World

SIZE = 64
WIDTH, HEIGHT = 256, 144
GROUND_M_PER_PX = 0.07
CAMERAS_PER_WORLD = 3
PALETTE_JITTER = 1.2
"""Of the colours in training, see `juncnet.simulation.palettes.jitter`."""
NEAR_JUNCTIONS = 0.6
"""Share of training poses drawn from the road before a junction."""

Poses = NDArray[np.float64]
"""(N, 4): x, y, yaw, distance to the mouth of the junction ahead (infinite: a dead end)."""


def drawn_camera(rng: np.random.Generator) -> CameraGeometry:
    """Return a camera as somebody might mount it on a copter or a rover."""
    height = float(np.exp(rng.uniform(math.log(1.2), math.log(5.0))))
    return CameraGeometry(
        height_m=height,
        pitch_rad=math.radians(rng.uniform(9, 26)),
        horizontal_fov_rad=math.radians(rng.uniform(68, 92)),
    )


def target(mouth_m: NDArray[np.float64], camera: CameraGeometry) -> NDArray[np.float32]:
    """Return the probability of *junction* to learn for mouths this far ahead (N,).

    1 within the band of the camera, 0 outside, with a linear ramp across each transition band, so
    that the score crosses one half where the band begins and ends.
    """
    band = camera.band
    far = (band.d_far_m * (1 + TRANSITION) - mouth_m) / (2 * TRANSITION * band.d_far_m)
    near = (mouth_m - band.d_near_m * (1 - TRANSITION)) / (2 * TRANSITION * band.d_near_m)
    return np.clip(np.minimum(far, near), 0, 1).astype(np.float32)


def labelled(
    poses: Poses, truth: GroundTruth, camera: CameraGeometry
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the label of each pose (index into `LABELS`) and the probability to learn.

    Where the junction ahead is within the band but too little of it can be seen, there is nothing
    to learn: NaN.
    """
    names = [truth.label(float(p[0]), float(p[1]), float(p[2]), camera) for p in poses]
    labels = np.array([LABELS.index(name) for name in names], np.uint8)
    wanted = target(poses[:, 3], camera)
    wanted[(wanted == 1) & (labels != LABELS.index("junction"))] = np.nan
    return labels, wanted


class PoseSampler:
    """Draws poses along the roads of a world, with the errors of a robot that follows them."""

    def __init__(self, world: World, network: RoadNetwork, rng: np.random.Generator):
        self._world, self._network, self._rng = world, network, rng
        self._arms = [2 * road + side for road in world.roads for side in (0, 1)]
        lengths = np.array([network.lengths[arm // 2] for arm in self._arms])
        self._weights = lengths / lengths.sum()

    def draw(self, n: int, spread: float, near_m: float | None) -> Poses:
        """Return `n` poses.

        Args:
            n: how many.
            spread: 1: the lateral and heading errors of ordinary flight (0.35 m, 4 degrees).
            near_m: with it, `NEAR_JUNCTIONS` of them lie within this distance of a mouth ahead.
        """
        rows = np.empty((n, 4))
        arms = self._rng.choice(len(self._arms), n, p=self._weights)
        for row, index in zip(rows, arms, strict=True):
            row[:] = self._pose(self._arms[int(index)], spread, near_m)
        return rows

    def _pose(self, arm: int, spread: float, near_m: float | None) -> tuple[float, ...]:
        rng, length = self._rng, self._network.lengths[arm // 2]
        ahead = arm_ends(self._world, arm)[1] in self._network.junctions
        setback = self._network.setback_m(reverse_arm(arm))
        left = float(rng.uniform(0, length))
        if near_m is not None and ahead and rng.random() < NEAR_JUNCTIONS:
            left = float(rng.uniform(0, min(length, setback + near_m)))
        centre = self._world.roads[arm // 2].centre
        centre = centre if arm % 2 == 0 else centre[::-1]
        position = (length - left) / length * (len(centre) - 1)
        i = min(int(position), len(centre) - 2)
        step = centre[i + 1] - centre[i]
        x, y = centre[i] + (position - i) * step
        heading = math.atan2(step[1], step[0])
        side = float(rng.normal(0, 0.35 * spread))
        yaw = heading + float(rng.normal(0, math.radians(4 * spread)))
        mouth = left - setback if ahead else math.inf
        return (x - side * math.sin(heading), y + side * math.cos(heading), yaw, mouth)


def world_samples(
    seed: int,
    n: int,
    *,
    training: bool,
    style: Style | None = None,
    camera: CameraGeometry | None = None,
) -> Samples:
    """Return `n` labelled pictures of the random world of this seed.

    Args:
        seed: of the world, and of everything drawn.
        n: how many pictures.
        training: poses crowd before junctions and err more, cameras vary; else they are uniform
            along the roads as driven, which is what accuracy is reported for.
        style: another look than the seed gives.
        camera: one camera instead of several drawn ones.
    """
    rng = np.random.default_rng([seed, 77])
    world = random_world(seed) if style is None else random_world(seed, style)
    if training:
        world = dataclasses.replace(world, style=_varied(world.style, rng))
    truth = GroundTruth(world)
    palette = palette_named(world.style.palette)
    if training:
        palette = jitter(palette, rng, PALETTE_JITTER)
    ground = GroundTexture(world, metres_per_px=GROUND_M_PER_PX, palette=palette)
    sampler = PoseSampler(world, truth.network, rng)
    parts: list[Samples] = []
    for k in range(1 if camera else CAMERAS_PER_WORLD):
        geometry = camera or drawn_camera(rng)
        share = n if camera else n // CAMERAS_PER_WORLD
        renderer = Renderer(world, WIDTH, HEIGHT, geometry, noise=3.0, seed=seed + k, ground=ground)
        near_m = 1.6 * geometry.band.d_far_m if training else None
        poses = sampler.draw(share, 1.8 if training else 1.0, near_m)
        tilt = rng.normal(0, math.radians(1.0 if training else 0.3), (share, 2))
        luma = [_luma(renderer, pose, t) for pose, t in zip(poses, tilt, strict=True)]
        gray = np.rint(np.stack([shrink(picture, SIZE) for picture in luma])).astype(np.uint8)
        labels, wanted = labelled(poses, truth, geometry)
        parts.append(
            Samples(
                gray=gray,
                target=wanted,
                label=labels,
                mouth_m=poses[:, 3].astype(np.float32),
                height_m=np.full(share, geometry.height_m, np.float32),
                site=np.full(share, seed, np.int64),
            )
        )
    return Samples.concatenate(parts)


def _varied(style: Style, rng: np.random.Generator) -> Style:
    return dataclasses.replace(
        style,
        sun_azimuth_rad=float(rng.uniform(-math.pi, math.pi)),
        sun_elevation_rad=float(rng.uniform(0.25, 1.3)),
        shadow=float(rng.uniform(0.1, 0.75)),
        haze=float(rng.uniform(0.0, 0.5)),
    )


def _luma(renderer: Renderer, pose: Poses, tilt: Poses) -> NDArray[np.uint8]:
    flat = renderer.render_i420(
        float(pose[0]),
        float(pose[1]),
        float(pose[2]),
        roll_rad=float(tilt[0]),
        pitch_rad=float(tilt[1]),
    )
    return flat[: WIDTH * HEIGHT].reshape(HEIGHT, WIDTH)


def main(argv: list[str] | None = None) -> int:
    """Write a set of pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--worlds", type=int, required=True)
    parser.add_argument("--per-world", type=int, default=500)
    parser.add_argument("--driven", action="store_true", help="uniform along driven paths")
    parser.add_argument("--palette", help="instead of the seed's own")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(argv)
    cv2.setNumThreads(1)
    started, parts = time.monotonic(), list[Samples]()
    for i in range(options.worlds):
        seed = options.first_seed + i
        style = None
        if options.palette:
            style = dataclasses.replace(random_world(seed).style, palette=options.palette)
        parts.append(
            world_samples(seed, options.per_world, training=not options.driven, style=style)
        )
        if (i + 1) % 10 == 0:
            elapsed = time.monotonic() - started
            print(f"{i + 1}/{options.worlds} worlds, {elapsed:.0f} s", flush=True)
    Samples.concatenate(parts).save(options.out)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
