"""`juncnet follower VIDEO --marks CSV`: how near a road follower's centre is to a marked one.

The marks are rows `clip,frame,row,left,right`: in this frame of the clip of this file name, at this
row, the road's surface lies between these columns, all as fractions of the picture, cut at its
sides. The follower sees every frame in order; where it sees no road it is wrong.
"""

import argparse
import csv
import json
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from juncnet.camera import CameraGeometry
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import PixelFormat, RoadSeen, Stamp
from juncnet_services.road_following.follower import load_follower
from juncnet_services.road_following.vision import VisionFollower

BUILT_IN = f"{VisionFollower.__module__}:{VisionFollower.__name__}"


@dataclass(frozen=True)
class Mark:
    """Where the road lies in one row of one frame; all but the frame are fractions."""

    frame: int
    row: float
    left: float
    right: float

    @property
    def centre(self) -> float:
        """The middle of what is seen of the road."""
        return (self.left + self.right) / 2


def read_marks(path: Path, clip: str) -> dict[int, Mark]:
    """Return the marks of the clip of this name, by frame number."""
    with path.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["clip"] == clip]
    marks = [
        Mark(int(r["frame"]), float(r["row"]), float(r["left"]), float(r["right"])) for r in rows
    ]
    return {mark.frame: mark for mark in marks}


def centre_in_picture(road: RoadSeen, camera: CameraGeometry, row: float) -> float | None:
    """Return the column of the middle of what is seen of `road` in a row; None: not there.

    Both edges are projected, cut at the picture's sides as marks are, and averaged.
    """
    ground = camera.ground(0.5, row)
    if ground is None or len(road.centre) < 2:
        return None
    x = np.array([point[0] for point in road.centre])
    y = np.array([point[1] for point in road.centre])
    slope = (y[-1] - y[-2]) / (x[-1] - x[-2])
    beyond = max(0.0, ground[0] - float(x[-1]))
    centre = float(np.interp(ground[0], x, y)) + slope * beyond
    sides = [camera.project(ground[0], centre + s * road.width_m / 2) for s in (1.0, -1.0)]
    columns = [min(max(side[0], 0.0), 1.0) for side in sides if side is not None]
    return sum(columns) / 2 if len(columns) == 2 else None


def read_frames(path: Path) -> Iterator[Frame]:
    """Yield the video's pictures as I420, stamped by their time in it."""
    import av

    with av.open(str(path)) as container:
        for number, picture in enumerate(container.decode(video=0)):
            pixels = picture.to_ndarray(format="yuv420p").reshape(-1)
            layout = FrameLayout.packed(PixelFormat.I420, picture.width, picture.height)
            time_ns = round((picture.time or 0.0) * 1e9)
            header = Stamp(epoch=0, sequence=number, time_ns=time_ns, clock="video")
            yield Frame(header, layout, np.asarray(pixels, dtype=np.uint8))


def evaluate(
    video: Path, marks: dict[int, Mark], follower_path: str, options: dict[str, Any]
) -> list[float | None]:
    """Return per marked frame the distance of the centres, in picture widths; None: no road."""
    follower = load_follower(follower_path, options)
    camera = CameraGeometry.model_validate(options.get("camera", {}))
    errors: list[float | None] = []
    for number, frame in enumerate(read_frames(video)):
        answer = follower.follow(frame, None)
        mark = marks.get(number)
        if mark is None:
            continue
        geometry = camera.model_copy(update={"aspect": frame.width / frame.height})
        road = answer.road if answer is not None else None
        centre = centre_in_picture(road, geometry, mark.row) if road is not None else None
        errors.append(None if centre is None else abs(centre - mark.centre))
    return errors


def _options(settings: Sequence[str]) -> dict[str, Any]:
    """Return the nested table of settings such as `camera.height_m=1.3`, values as in TOML."""
    lines: list[str] = []
    for setting in settings:
        key, _, value = setting.partition("=")
        try:
            tomllib.loads(f"value = {value}")
        except tomllib.TOMLDecodeError:
            value = json.dumps(value)
        lines.append(f"{key} = {value}")
    return tomllib.loads("\n".join(lines))


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures of one video; return 1 when fewer than 90 % are within the tolerance."""
    parser = argparse.ArgumentParser(prog="juncnet follower", description=__doc__)
    parser.add_argument("video", type=Path)
    parser.add_argument("--marks", type=Path, required=True)
    parser.add_argument("--follower", default=BUILT_IN, help="package.module:Class")
    parser.add_argument("--set", action="append", default=[], metavar="OPTION=VALUE", dest="set")
    parser.add_argument("--tolerance", type=float, default=0.10, help="in picture widths")
    arguments = parser.parse_args(argv)
    marks = read_marks(arguments.marks, arguments.video.name)
    if not marks:
        parser.error(f"{arguments.marks} has no marks of {arguments.video.name}")
    errors = evaluate(arguments.video, marks, arguments.follower, _options(arguments.set))
    seen = [error for error in errors if error is not None]
    good = sum(error <= arguments.tolerance for error in seen)
    share = good / len(marks)
    middle = f"{np.median(seen):.3f}, largest {max(seen):.3f}" if seen else "none"
    print(f"{good} of {len(marks)} marked frames ({share:.0%}) within {arguments.tolerance:g}")
    print(f"no road in {len(errors) - len(seen)}; median distance {middle} (picture widths)")
    return 0 if share >= 0.9 else 1
