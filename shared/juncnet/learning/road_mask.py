"""The road mask network of the built-in follower: pictures of simulated worlds, training, export.

`python -m juncnet.learning.road_mask --out FILE` trains a network by the recipe of the second of
the two that the shipped one is the mean of, in about an hour on one core. Everything is drawn from
`--seed`. Worlds have seeds from 1,000,000; those that are scored from 1,900,000. The palette
`withheld` is scored and nothing else.
"""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

import argparse
import hashlib
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import compose, helper
from torch import Tensor, nn
from torch.nn import functional

from juncnet.camera import CameraGeometry
from juncnet.frames import Frame, FrameLayout
from juncnet.inference import Network
from juncnet.messages import PixelFormat, Stamp
from juncnet.simulation.ground import GroundTexture
from juncnet.simulation.palettes import jitter, palette_named
from juncnet.simulation.render import Renderer
from juncnet.simulation.towns import make_style, random_world
from juncnet.simulation.world import Road, World
from juncnet.small_picture import SIZE, shrink

TRAINING_SEED, TEST_SEED = 1_000_000, 1_900_000
SHAPES = ((480, 270), (480, 270), (400, 300))
"""Sizes that training pictures are rendered at."""
NEAR_JUNCTION_M, NEAR_JUNCTION = 14.0, 0.5
"""So many of the pictures in training are from within this distance of a junction."""
PALETTE_JITTER = 1.5
"""Of the colours in training, see `juncnet.simulation.palettes.jitter`."""
INPUT, OUTPUT = "picture", "road"
MASK_SIZE = (SIZE[0] // 2, SIZE[1] // 2)
Bytes = NDArray[np.uint8]


class RoadMaskNet(nn.Module):
    """Encoder and decoder with skips: uint8 YUV (N, 96, 160, 3) to probabilities (N, 48, 80).

    Luminance is standardised picture by picture, so that exposure does not matter; the row is a
    fourth channel.
    """

    def __init__(self) -> None:
        super().__init__()
        self.top = _block(4, 12, 2)
        self.quarter = _block(12, 24, 2)
        self.eighth = nn.Sequential(_block(24, 32, 2), _block(32, 32, 1))
        self.sixteenth = nn.Sequential(_block(32, 48, 2), _block(48, 48, 1), _block(48, 48, 1))
        self.up_eighth = nn.Sequential(_block(80, 32, 1, 1), _block(32, 32, 1))
        self.up_quarter = nn.Sequential(_block(56, 20, 1, 1), _block(20, 20, 1))
        self.up_half = nn.Sequential(_block(32, 12, 1, 1), _block(12, 12, 1))
        self.out = nn.Conv2d(12, 1, 1)

    def logits(self, picture: Tensor) -> Tensor:
        """Return logits (N, 48, 80) of pictures (N, 96, 160, 3), uint8 or float 0..255."""
        x = picture.float().permute(0, 3, 1, 2)
        luma = x[:, :1]
        centred = luma - luma.mean(dim=(2, 3), keepdim=True)
        spread = torch.sqrt((centred * centred).mean(dim=(2, 3), keepdim=True) + 25.0)
        row = torch.linspace(-1.0, 1.0, SIZE[1]).view(1, 1, -1, 1) + torch.zeros_like(luma)
        x = torch.cat([centred / spread, (x[:, 1:] - 128.0) / 24.0, row], dim=1)
        half = self.top(x)
        quarter = self.quarter(half)
        eighth = self.eighth(quarter)
        deep = self.sixteenth(eighth)
        up = self.up_eighth(torch.cat([_twice(deep), eighth], dim=1))
        up = self.up_quarter(torch.cat([_twice(up), quarter], dim=1))
        up = self.up_half(torch.cat([_twice(up), half], dim=1))
        answer: Tensor = self.out(up)[:, 0]
        return answer

    def forward(self, picture: Tensor) -> Tensor:
        """Return probabilities (N, 48, 80)."""
        return torch.sigmoid(self.logits(picture))


def _block(inputs: int, outputs: int, stride: int, kernel: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride=stride, padding=kernel // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


def _twice(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


@dataclass(frozen=True)
class Pictures:
    """Small pictures, uint8 (N, 96, 160, 3), and how much of a cell is road, (N, 48, 80) uint8."""

    pictures: Bytes
    roads: Bytes


def draw_pictures(
    worlds: list[World], each: int, seed: int, full_range: bool = True, varied: bool = False
) -> Pictures:
    """Return `each` pictures of every world from random poses on and beside its roads.

    `full_range`: heights 0.6..5 m, pitches 2..38 degrees, fields of view 55..95 degrees, headings
    up to 45 degrees off; else the cameras and poses of a robot that follows the road. `varied`:
    colours of the palettes varied at random, world by world.
    """
    pictures: list[Bytes] = []
    roads: list[Bytes] = []
    for number, world in enumerate(worlds):
        rng = np.random.default_rng([seed, world.seed])
        renderers = _renderers(world, seed + number, rng if varied else None)
        for _ in range(each):
            renderer = renderers[int(rng.integers(len(renderers)))]
            renderer.camera = _camera(rng, full_range)
            pose = _pose(world, rng, full_range)
            tilt = rng.normal(0.0, 0.03, 2) if full_range else np.zeros(2)
            picture, road = _sample(renderer, pose, (float(tilt[0]), float(tilt[1])))
            pictures.append(picture)
            roads.append(road)
    return Pictures(np.stack(pictures), np.stack(roads))


def _renderers(world: World, seed: int, rng: np.random.Generator | None) -> list[Renderer]:
    camera, palette = CameraGeometry(), palette_named(world.style.palette)
    ground = GroundTexture(world, palette=jitter(palette, rng, PALETTE_JITTER) if rng else palette)
    first = Renderer(world, *SHAPES[0], camera, noise=4.0, seed=seed, ground=ground)
    other = Renderer(world, *SHAPES[2], camera, noise=1.0, seed=seed, ground=ground)
    return [first, other]


def _camera(rng: np.random.Generator, full_range: bool) -> CameraGeometry:
    if not full_range:
        return CameraGeometry()
    height_m = float(np.exp(rng.uniform(math.log(0.6), math.log(5.0))))
    return CameraGeometry(
        height_m=height_m,
        pitch_rad=math.radians(float(rng.uniform(2.0, 38.0))),
        horizontal_fov_rad=math.radians(float(rng.uniform(55.0, 95.0))),
    )


def _pose(world: World, rng: np.random.Generator, full_range: bool) -> tuple[float, float, float]:
    """Return x, y, yaw on or beside a road, along it more often than across."""
    roads = [world.roads[i] for i in sorted(world.roads)]
    road = roads[int(rng.integers(len(roads)))]
    at = int(rng.integers(1, len(road.centre) - 1))
    if full_range and rng.random() < NEAR_JUNCTION:
        road, at = _near_junction(world, rng)
    along = road.centre[at + 1] - road.centre[at - 1]
    if rng.random() < 0.5:
        along = -along
    yaw = math.atan2(along[1], along[0])
    aside = rng.uniform(-0.6, 0.6) * road.width_m if full_range else rng.normal(0.0, 0.5)
    x, y = road.centre[at] + aside * np.array([-math.sin(yaw), math.cos(yaw)])
    spread = 0.12 if not full_range or rng.random() < 0.5 else 0.45
    return (float(x), float(y), yaw + float(np.clip(rng.normal(0.0, spread), -0.8, 0.8)))


def _near_junction(world: World, rng: np.random.Generator) -> tuple[Road, int]:
    """Return an arm of a junction, and which point of its centre, near that junction."""
    nodes = [node for node in sorted(world.nodes) if world.is_junction(node)]
    node = nodes[int(rng.integers(len(nodes)))]
    arms = world.roads_at(node)
    road = arms[int(rng.integers(len(arms)))]
    step_m = float(np.hypot(*(road.centre[1] - road.centre[0])))
    last = len(road.centre) - 2
    away = min(last, 1 + int(rng.uniform(0.0, NEAR_JUNCTION_M) / step_m))
    return (road, away if node == road.a else last + 1 - away)


def _sample(
    renderer: Renderer, pose: tuple[float, float, float], tilt: tuple[float, float]
) -> tuple[Bytes, Bytes]:
    roll, pitch = tilt
    pixels = renderer.render_i420(*pose, roll_rad=roll, pitch_rad=pitch)
    layout = FrameLayout.packed(PixelFormat.I420, renderer.width, renderer.height)
    header = Stamp(epoch=0, sequence=0, time_ns=0, clock="training")
    mask = renderer.road_mask(
        *pose, renderer.width, renderer.height, roll_rad=roll, pitch_rad=pitch
    )
    road = cv2.resize(mask, MASK_SIZE, interpolation=cv2.INTER_AREA)
    return shrink(Frame(header, layout, pixels)), np.asarray(road, dtype=np.uint8)


def augmented(pictures: Tensor, roads: Tensor, rng: torch.Generator) -> tuple[Tensor, Tensor]:
    """Return a batch (N, 96, 160, 3), 0..255, and (N, 48, 80), 0..1, as others would see it.

    Mirrored, cut, brighter or darker, shaded, of other contrast and colour, blurred, noisy.
    """
    count = len(pictures)

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(count, *shape, generator=rng)

    x = pictures.float().permute(0, 3, 1, 2)
    y = roads.float()[:, None] / 255.0
    mirror = torch.where(uniform(0, 1) < 0.5, -1.0, 1.0)
    zoom_x, zoom_y = uniform(0.6, 1.0), uniform(0.6, 1.0)
    zoom_x = torch.where(uniform(0, 1) < 0.5, torch.ones(count), zoom_x)
    zoom_y = torch.where(uniform(0, 1) < 0.5, torch.ones(count), zoom_y)
    theta = torch.zeros(count, 2, 3)
    theta[:, 0, 0], theta[:, 1, 1] = mirror * zoom_x, zoom_y
    theta[:, 0, 2] = uniform(-1, 1) * (1 - zoom_x)
    theta[:, 1, 2] = uniform(-1, 1) * (1 - zoom_y)
    size = [count, 1, SIZE[1], SIZE[0]]
    grid = functional.affine_grid(theta, size, align_corners=False)
    x = functional.grid_sample(x, grid, padding_mode="border", align_corners=False)
    half = functional.affine_grid(
        theta, [count, 1, MASK_SIZE[1], MASK_SIZE[0]], align_corners=False
    )
    y = functional.grid_sample(y, half, padding_mode="border", align_corners=False)

    soft = functional.avg_pool2d(x, 3, 1, 1, count_include_pad=False)
    x = torch.lerp(x, soft, uniform(-0.5, 1.0, 1, 1, 1))
    gamma = torch.exp(uniform(-0.5, 0.5, 1, 1, 1))
    luma = 255.0 * (x[:, :1].clamp(0, 255) / 255.0) ** gamma
    shade = functional.interpolate(uniform(0.6, 1.3, 1, 3, 4), size=SIZE[::-1], mode="bicubic")
    shade = torch.where(uniform(0, 1, 1, 1, 1) < 0.5, torch.ones_like(shade), shade)
    luma = luma * shade * uniform(0.4, 1.4, 1, 1, 1) + uniform(-15, 25, 1, 1, 1)
    chroma = (x[:, 1:] - 128.0) * uniform(0.2, 1.6, 1, 1, 1) + 128.0 + uniform(-16, 16, 2, 1, 1)
    x = torch.cat([luma, chroma], dim=1)
    x = x + torch.randn(x.shape, generator=rng) * uniform(0.0, 6.0, 1, 1, 1)
    return x.clamp(0, 255).permute(0, 2, 3, 1), y[:, 0]


def train(data: Pictures, epochs: int, seed: int, limit_s: float) -> RoadMaskNet:
    """Return a network trained for `epochs`, fewer if `limit_s` would be passed, on one thread."""
    torch.manual_seed(seed)
    rng = torch.Generator().manual_seed(seed)
    pictures, roads = torch.from_numpy(data.pictures), torch.from_numpy(data.roads)
    network = RoadMaskNet()
    network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]  # not in stubs
    optimiser = torch.optim.AdamW(network.parameters(), lr=4e-3, weight_decay=1e-4)
    steps = epochs * (len(pictures) // 64)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 4e-3, total_steps=steps)
    begun = time.monotonic()
    for epoch in range(epochs):
        total = 0.0
        for batch in _batches(len(pictures), 64, rng):
            x, y = augmented(pictures[batch], roads[batch], rng)
            loss = functional.binary_cross_entropy_with_logits(network.logits(x), y)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total += float(loss.detach())
        passed_s = time.monotonic() - begun
        print(f"epoch {epoch + 1}: loss {total / (len(pictures) // 64):.4f}, {passed_s:.0f} s")
        if passed_s > limit_s:
            print(f"stopped: {limit_s:g} s have passed; the result is not the recipe's")
            break
    return network.eval()


def _batches(count: int, size: int, rng: torch.Generator) -> Iterator[Tensor]:
    order = torch.randperm(count, generator=rng)
    for first in range(0, count - size + 1, size):
        yield order[first : first + size]


def intersection_over_union(file: Path, data: Pictures) -> float:
    """Return the IoU of road over all cells of all pictures together, both cut at one half."""
    network = Network(file.read_bytes())
    both = either = 0
    for picture, road in zip(data.pictures, data.roads, strict=True):
        found, truth = network.run(picture[None], INPUT, OUTPUT)[0] > 0.5, road > 127
        both += int((found & truth).sum())
        either += int((found | truth).sum())
    return both / max(either, 1)


def export(network: RoadMaskNet, path: Path) -> None:
    """Write the network to an ONNX file."""
    probe = torch.zeros(1, SIZE[1], SIZE[0], 3, dtype=torch.uint8)
    torch.onnx.export(
        network,
        (probe,),
        str(path),
        input_names=[INPUT],
        output_names=[OUTPUT],
        opset_version=17,
        dynamo=False,
    )


def export_mean(first: Path, second: Path, path: Path) -> None:
    """Write an ONNX file that answers with the mean of what two exported networks answer."""
    one, other = (
        compose.add_prefix(onnx.load(str(file)), f"{name}/")
        for name, file in (("first", first), ("second", second))
    )
    mean = one.graph
    mean.node.extend(other.graph.node)
    mean.initializer.extend(other.graph.initializer)
    inputs = {mean.input[0].name, other.graph.input[0].name}
    for node in mean.node:
        node.input[:] = [INPUT if name in inputs else name for name in node.input]
    answers = [mean.output[0].name, other.graph.output[0].name]
    mean.node.append(helper.make_node("Mean", answers, [OUTPUT]))
    mean.input[0].name, mean.output[0].name = INPUT, OUTPUT
    onnx.checker.check_model(one)
    onnx.save(one, str(path))


def scores(file: Path, worlds: int, each: int) -> dict[str, float]:
    """Return the IoU by kind of test pictures, none of whose worlds was trained on."""
    seeds = range(TEST_SEED, TEST_SEED + worlds)
    unseen = [random_world(seed) for seed in seeds]
    withheld = [random_world(seed, make_style("withheld", "noon", seed)) for seed in seeds]
    kinds = {
        "unseen worlds, all cameras and poses": (unseen, True),
        "unseen worlds, default camera along the road": (unseen, False),
        "palette `withheld`, all cameras and poses": (withheld, True),
        "palette `withheld`, default camera along the road": (withheld, False),
    }
    return {
        name: intersection_over_union(file, draw_pictures(where, each, TEST_SEED, full_range))
        for name, (where, full_range) in kinds.items()
    }


def main() -> None:
    """Draw pictures, train, export, score; or score only."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    task = parser.add_mutually_exclusive_group(required=True)
    task.add_argument("--out", type=Path, help="train, and write this ONNX file")
    task.add_argument("--score", type=Path, help="an ONNX file: only score it")
    parser.add_argument("--mean-with", type=Path, help="write the mean with this earlier mask")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--worlds", type=int, default=440)
    parser.add_argument("--pictures", type=int, default=100, help="of each world")
    parser.add_argument("--epochs", type=int, default=10)
    parser.add_argument("--limit-s", type=float, default=7200.0, help="training ends after this")
    options = parser.parse_args()
    if options.mean_with and (options.score or not options.mean_with.is_file()):
        parser.error(f"--mean-with {options.mean_with}: name an existing mask, and use --out")
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    file: Path = options.score or options.out
    if options.out:
        _make(options, file)
    print(f"{file}: sha256 {hashlib.sha256(file.read_bytes()).hexdigest()}")
    for name, value in scores(file, worlds=8, each=60).items():
        print(f"IoU {value:.4f} {name}")


def _make(options: argparse.Namespace, file: Path) -> None:
    worlds = [random_world(TRAINING_SEED + 1000 * options.seed + i) for i in range(options.worlds)]
    data = draw_pictures(worlds, options.pictures, options.seed, varied=True)
    print(f"{len(data.pictures)} pictures")
    export(train(data, options.epochs, options.seed, options.limit_s), file)
    if options.mean_with:
        export_mean(options.mean_with, file, file)


if __name__ == "__main__":
    main()
