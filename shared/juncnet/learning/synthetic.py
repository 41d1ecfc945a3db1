"""Labelled pictures from simulated worlds, along the roads that a robot drives.

Seeds from 1,000,000 on are for training, from 2,000,000 on for validation during training, from
3,000,000 on for the figures in the model card; seeds below 1,000,000 are for flying.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from juncnet.camera import TRANSITION, CameraGeometry
from juncnet.learning.imperfections import Faults, Lens
from juncnet.learning.samples import LABELS, MASK_SIZE, Samples, small_mask
from juncnet.shrink import shrink
from juncnet.simulation.ground import JUNCTION, GroundTexture
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
SURFACE_SHARE = 0.05
"""Where so much of a picture is a junction's surface, it is learned though few mouths are seen."""
Range = tuple[float, float]
"""Lowest and highest."""
Poses = NDArray[np.float64]
"""(N, 4): x, y, yaw, distance to the mouth of the junction ahead (infinite: a dead end)."""


class Variety(BaseModel):
    """From what ranges everything is drawn; angles in degrees."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    height_m: Range = (1.2, 5.0)
    pitch_deg: Range = (9.0, 26.0)
    fov_deg: Range = (68.0, 92.0)
    tilt_deg: float = Field(default=1.0, ge=0, le=20)
    """Standard deviation of roll and of pitch around the camera's own."""
    wander: float = Field(default=1.8, ge=0, le=5)
    """1: the lateral and heading errors of ordinary flight (0.35 m, 4 degrees)."""
    near_junctions: float = Field(default=0.6, ge=0, le=1)
    """Share of the poses drawn from the road before a junction; the rest is uniform along roads."""
    palette_jitter: float = Field(default=1.2, ge=0, le=3)
    """Of all colours, see `juncnet.simulation.palettes.jitter`."""
    sun_elevation_deg: Range = (14.0, 75.0)
    shadow: Range = (0.1, 0.75)
    haze: Range = (0.0, 0.5)
    noise: float = Field(default=3.0, ge=0, le=40)
    """Standard deviation of the sensor's noise, grey levels."""
    distortion: float = Field(default=0.06, ge=0, le=0.4)
    """Largest radial lens distortion k1 at the picture's half diagonal, either way."""
    motion_blur: float = Field(default=0.15, ge=0, le=1)
    """Share of the pictures blurred by motion."""
    compression: float = Field(default=0.3, ge=0, le=1)
    """Share of the pictures that went through JPEG, quality 15 to 80."""


DRIVEN = Variety(
    tilt_deg=0.3,
    wander=1.0,
    near_junctions=0.0,
    palette_jitter=0.0,
    distortion=0.0,
    motion_blur=0.0,
    compression=0.0,
)
"""Frames sampled uniformly along driven paths, in the worlds' own looks: what figures are for."""


def drawn_camera(rng: np.random.Generator, variety: Variety = DRIVEN) -> CameraGeometry:
    """Return a camera as somebody might mount it on a copter or a rover."""
    low, high = variety.height_m
    return CameraGeometry(
        height_m=float(np.exp(rng.uniform(math.log(low), math.log(high)))),
        pitch_rad=math.radians(rng.uniform(*variety.pitch_deg)),
        horizontal_fov_rad=math.radians(rng.uniform(*variety.fov_deg)),
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
    poses: Poses, truth: GroundTruth, camera: CameraGeometry, masks: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the label of each pose (index into `LABELS`) and the probability to learn.

    Where the junction ahead is within the band but too little of it can be seen, neither two of
    its mouths nor, in `masks` (N, M, M), enough of its surface, there is nothing to learn: NaN.
    """
    names = [truth.label(float(p[0]), float(p[1]), float(p[2]), camera) for p in poses]
    labels = np.array([LABELS.index(name) for name in names], np.uint8)
    wanted = target(poses[:, 3], camera)
    hidden = (wanted == 1) & (labels != LABELS.index("junction"))
    surface = (masks == JUNCTION).mean(axis=(1, 2))
    wanted[hidden & (surface < SURFACE_SHARE)] = np.nan
    return labels, wanted


class PoseSampler:
    """Draws poses along the roads of a world, with the errors of a robot that follows them."""

    def __init__(self, world: World, network: RoadNetwork, rng: np.random.Generator):
        self._world, self._network, self._rng = world, network, rng
        self._arms = [2 * road + side for road in world.roads for side in (0, 1)]
        lengths = np.array([network.lengths[arm // 2] for arm in self._arms])
        self._weights = lengths / lengths.sum()

    def draw(self, n: int, wander: float, near_share: float, near_m: float) -> Poses:
        """Return `n` poses.

        Args:
            n: how many.
            wander: 1: the lateral and heading errors of ordinary flight (0.35 m, 4 degrees).
            near_share: share of them that lie within `near_m` of a mouth ahead.
            near_m: metres.
        """
        rows = np.empty((n, 4))
        arms = self._rng.choice(len(self._arms), n, p=self._weights)
        for row, index in zip(rows, arms, strict=True):
            row[:] = self._pose(self._arms[int(index)], wander, near_share, near_m)
        return rows

    def _pose(self, arm: int, wander: float, near_share: float, near_m: float) -> tuple[float, ...]:
        rng, length = self._rng, self._network.lengths[arm // 2]
        ahead = arm_ends(self._world, arm)[1] in self._network.junctions
        setback = self._network.setback_m(reverse_arm(arm))
        left = float(rng.uniform(0, length))
        if near_share and ahead and rng.random() < near_share:
            left = float(rng.uniform(0, min(length, setback + near_m)))
        centre = self._world.roads[arm // 2].centre
        centre = centre if arm % 2 == 0 else centre[::-1]
        position = (length - left) / length * (len(centre) - 1)
        i = min(int(position), len(centre) - 2)
        step = centre[i + 1] - centre[i]
        x, y = centre[i] + (position - i) * step
        heading = math.atan2(step[1], step[0])
        side = float(rng.normal(0, 0.35 * wander))
        yaw = heading + float(rng.normal(0, math.radians(4 * wander)))
        mouth = left - setback if ahead else math.inf
        return (x - side * math.sin(heading), y + side * math.cos(heading), yaw, mouth)


def world_samples(
    seed: int, n: int, variety: Variety, style: Style | None = None, palette: str | None = None
) -> Samples:
    """Return `n` labelled pictures of the random world of this seed.

    Args:
        seed: of the world, and of everything drawn.
        n: how many pictures.
        variety: what is drawn from where.
        style: another look than the seed gives.
        palette: the name of another palette than the style's.
    """
    rng = np.random.default_rng([seed, 77])
    world = random_world(seed) if style is None else random_world(seed, style)
    if variety.palette_jitter > 0:
        world = dataclasses.replace(world, style=_varied(world.style, variety, rng))
    truth = GroundTruth(world)
    colours = palette_named(palette or world.style.palette)
    if variety.palette_jitter > 0:
        colours = jitter(colours, rng, variety.palette_jitter)
    ground = GroundTexture(world, metres_per_px=GROUND_M_PER_PX, palette=colours)
    sampler = PoseSampler(world, truth.network, rng)
    shares = [
        n // CAMERAS_PER_WORLD + (k < n % CAMERAS_PER_WORLD) for k in range(CAMERAS_PER_WORLD)
    ]
    parts: list[Samples] = []
    for k, share in enumerate(s for s in shares if s):
        camera = drawn_camera(rng, variety)
        renderer = Renderer(
            world, WIDTH, HEIGHT, camera, noise=variety.noise, seed=seed + k, ground=ground
        )
        near_m = 1.6 * camera.band.d_far_m
        poses = sampler.draw(share, variety.wander, variety.near_junctions, near_m)
        gray, masks = _pictures(renderer, poses, variety, rng)
        labels, wanted = labelled(poses, truth, camera, masks)
        parts.append(
            Samples(
                gray=gray,
                target=wanted,
                label=labels,
                mouth_m=poses[:, 3].astype(np.float32),
                height_m=np.full(share, camera.height_m, np.float32),
                site=np.full(share, seed, np.int64),
                mask=masks,
            )
        )
    return Samples.concatenate(parts)


def _varied(style: Style, variety: Variety, rng: np.random.Generator) -> Style:
    return dataclasses.replace(
        style,
        sun_azimuth_rad=float(rng.uniform(-math.pi, math.pi)),
        sun_elevation_rad=math.radians(rng.uniform(*variety.sun_elevation_deg)),
        shadow=float(rng.uniform(*variety.shadow)),
        haze=float(rng.uniform(*variety.haze)),
    )


def _pictures(
    renderer: Renderer, poses: Poses, variety: Variety, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the pictures (N, SIZE, SIZE) from these poses, and their masks (N, M, M)."""
    n = len(poses)
    gray = np.empty((n, SIZE, SIZE), np.uint8)
    masks = np.empty((n, MASK_SIZE, MASK_SIZE), np.uint8)
    tilts = rng.normal(0, math.radians(variety.tilt_deg), (n, 2))
    lens = Lens.drawn(rng, variety.distortion, (WIDTH, HEIGHT))
    faults = Faults(variety.motion_blur, variety.compression)
    for index, (pose, tilt) in enumerate(zip(poses, tilts, strict=True)):
        x, y, yaw = (float(v) for v in pose[:3])
        roll, pitch = (float(v) for v in tilt)
        flat = renderer.render_i420(x, y, yaw, roll_rad=roll, pitch_rad=pitch)
        luma = lens.bend(flat[: WIDTH * HEIGHT].reshape(HEIGHT, WIDTH))
        gray[index] = np.rint(shrink(faults.add(luma, rng), SIZE))
        size = (2 * MASK_SIZE, 2 * MASK_SIZE * HEIGHT // WIDTH)
        mask = renderer.road_mask(x, y, yaw, *size, roll_rad=roll, pitch_rad=pitch, classes=True)
        masks[index] = small_mask(lens.bend(mask, smooth=False))
    return gray, masks
