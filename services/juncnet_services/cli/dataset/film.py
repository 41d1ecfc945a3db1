"""`juncnet dataset film --seed N --out DIR`: videos of simulated drives, to try the way to a model.

Every clip is a drive through one junction of a random town, or along plain road, as H.264; DIR also
gets `labels.csv`, the interval file that a careful person would write: *junction* while the mouth
ahead is in the camera's band and in sight, *none* on plain road, nothing where it is a matter of
taste. Repeated drives differ in sway, speed, noise and sun.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet.learning.footage.drives import (
    Drive,
    intervals_of,
    junction_drives,
    labels_of,
    path_of,
    poses,
    road_drives,
)
from juncnet.learning.footage.intervals import FootageError, Interval, write_intervals
from juncnet.learning.footage.writer import write_atomically
from juncnet.simulation.palettes import palette_named
from juncnet.simulation.render import Renderer
from juncnet.simulation.towns import make_style
from juncnet.simulation.truth import GroundTruth
from juncnet.simulation.world import World
from juncnet_services.cli.ranges import whole, why
from juncnet_services.simulator.setup import Config, make_camera, make_world

BEFORE_M, AFTER_M = 42.0, 20.0
"""Road filmed before and behind a junction's middle."""
ROAD_M = 30.0
"""Length of a drive along plain road."""


def write_video(
    path: Path, pictures: Iterable[NDArray[np.uint8]], size: tuple[int, int], fps: int
) -> int:
    """Write flat I420 pictures of `size` (width, height) as H.264; return how many there were."""
    width, height = size
    path.parent.mkdir(parents=True, exist_ok=True)
    count = 0
    with av.open(str(path), "w") as container:
        # av's stubs leave the types of options and packets open.
        stream = container.add_stream("libx264", rate=fps)  # pyright: ignore[reportUnknownMemberType]
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"preset": "ultrafast", "crf": "26", "x264-params": "threads=1"}
        for flat in pictures:
            frame = VideoFrame.from_ndarray(flat.reshape(height * 3 // 2, width), format="yuv420p")
            frame.pts, count = count, count + 1
            container.mux(stream.encode(frame))  # pyright: ignore[reportUnknownMemberType]
        container.mux(stream.encode(None))  # pyright: ignore[reportUnknownMemberType]
    return count


def chosen_drives(
    world: World, camera: CameraGeometry, seed: int, junctions: int, skip: int, roads: int
) -> list[Drive]:
    """Return drives through `junctions` junctions and along `roads` roads, drawn by `seed`.

    `skip` leaves out that many sites of each kind first: what another call has filmed.

    Raises:
        FootageError: the town does not have that many.
    """
    rng = np.random.default_rng([seed, 61])
    nodes = sorted(GroundTruth(world).network.junctions)
    order: list[int] = rng.permutation(len(nodes)).tolist()
    picked = [nodes[i] for i in order][skip : skip + junctions]
    plain = road_drives(world, camera, ROAD_M)
    names = sorted({drive.site for drive in plain})
    road_order: list[int] = rng.permutation(len(names)).tolist()
    sites = [names[i] for i in road_order][skip : skip + roads]
    if len(picked) < junctions or len(sites) < roads:
        raise FootageError(
            f"this town has {len(nodes)} junctions and {len(names)} long roads: "
            "ask for fewer, or for another --seed"
        )
    return [
        *(drive for node in picked for drive in junction_drives(world, node, BEFORE_M, AFTER_M)),
        *(drive for drive in plain if drive.site in sites),
    ]


class Film:
    """Films drives of one town with one camera."""

    def __init__(self, config: Config, fps: int, named: bool) -> None:
        """`named`: every junction is a class of its own, called as its site."""
        self.config, self.fps, self.named = config, fps, named
        self.size = (config.width, config.height)
        self.camera = make_camera(config)
        self.world = make_world(config)
        self.truth = GroundTruth(self.world)

    def renderer(self, day: int) -> Renderer:
        """Return the town as it looks on another day: the same place under another sun."""
        style = self.world.style
        sun = make_style(style.palette, style.time_of_day, 1000 * day + self.config.seed)
        world = self.world if day == 0 else replace(self.world, style=sun)
        noise, (width, height) = self.config.noise, self.size
        return Renderer(world, width, height, self.camera, noise, self.config.seed + day)

    def take(
        self, drive: Drive, renderer: Renderer, out: Path, clip: str, seed: int
    ) -> list[Interval]:
        """Write the clip and return what it shows."""
        rng = np.random.default_rng([self.config.seed, seed])
        where = poses(path_of(self.world, drive), float(rng.uniform(2.0, 3.2)), self.fps, rng)
        tilt = rng.normal(0, 0.006, (len(where), 2))

        def pictures() -> Iterator[NDArray[np.uint8]]:
            for (x, y, yaw), (roll, pitch) in zip(where.tolist(), tilt.tolist(), strict=True):
                yield renderer.render_i420(x, y, yaw, 0.0, roll, pitch)

        write_video(out / clip, pictures(), self.size, self.fps)
        labels = labels_of(self.truth, where, self.camera, drive)
        if self.named:
            labels = [drive.site if label == "junction" else label for label in labels]
        return intervals_of(clip, drive.site, labels, self.fps)


def main(argv: list[str]) -> int:
    """Film; 2 when something given is wrong."""
    options = _parser().parse_args(argv)
    cv2.setNumThreads(1)
    try:
        if options.out.exists() and any(options.out.iterdir()):
            raise FootageError(f"{options.out} is not empty: name another folder with --out")
        config = Config(
            seed=options.seed,
            palette=options.palette,
            width=options.height * 16 // 9 // 2 * 2,
            height=options.height,
        )
        if config.palette:
            palette_named(config.palette)
        film = Film(config, options.fps, options.name_junctions)
        drives = chosen_drives(
            film.world, film.camera, options.seed, options.junctions, options.skip, options.roads
        )
    except (FootageError, ValueError) as error:
        print(f"juncnet dataset film: {why(error)}", file=sys.stderr)
        return 2
    intervals: list[Interval] = []
    for day in range(options.first_day, options.first_day + options.days):
        renderer = film.renderer(day)
        for number, drive in enumerate(drives):
            clip = f"{drive.site}/day{day}-drive{number:02d}.mp4"
            intervals += film.take(drive, renderer, options.out, clip, 1000 * day + number)
            print(clip, flush=True)
            write_atomically(options.out / "labels.csv", write_intervals(intervals))
    print(f"wrote {len(drives) * options.days} clips and {options.out / 'labels.csv'}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="juncnet dataset film",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--seed", type=whole(0), required=True, help="of the town, as for `juncnet demo`")
    add("--out", type=Path, required=True, metavar="DIR", help="a new folder")
    add("--junctions", type=whole(0), default=3, metavar="N", help="junctions filmed (3)")
    add("--roads", type=whole(0), default=3, metavar="N", help="plain roads filmed (3)")
    add("--skip", type=whole(0), default=0, metavar="N", help="leave out the first N of each")
    add("--days", type=whole(1), default=2, metavar="N", help="drives over the same way (2)")
    add("--first-day", type=whole(0), default=0, metavar="N", help="number of the first day (0)")
    add("--palette", help="colours other than the town's own, as simulator.palette")
    add("--height", type=whole(36), default=720, metavar="PX", help="of the pictures, 16:9 (720)")
    add("--fps", type=whole(1), default=25, metavar="N", help="pictures a second (25)")
    add(
        "--name-junctions",
        action="store_true",
        help="every junction is a class of its own: telling them apart is a localisation",
    )
    return parser
