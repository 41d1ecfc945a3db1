"""`juncnet dataset synthesise FOLDER`: labelled pictures from simulation, thousands a minute.

Worlds are simulated villages seen by a robot that follows their roads; streets are towns and
motorways as photographs show them. The same options and seed give the same pictures. An interrupted
run goes on where it was: shards that are there are kept. A folder belongs to one set of options,
which stand in its `options.json`.
"""

import argparse
import json
import math
import multiprocessing
import os
import shlex
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from juncnet_services.cli.ranges import why
from juncnet_services.cli.train_extra import needs_train

if TYPE_CHECKING:
    from juncnet.learning.samples import Samples
    from juncnet.learning.synthetic import Variety

PER_SHARD = 6_000
PER_WORLD = 600
PER_STREET_SITE = 300
SEEDS = 1000
"""Between the first worlds of two shards: no more worlds than that fit into one."""
OPTIONS = "options.json"
RANGES = ("height_m", "pitch_deg", "fov_deg", "sun_elevation_deg", "shadow", "haze")
NUMBERS = (
    "tilt_deg",
    "wander",
    "near_junctions",
    "palette_jitter",
    "noise",
    "distortion",
    "motion_blur",
    "compression",
)


@dataclass(frozen=True)
class Site:
    """What is made at once: pictures of one world, or of streets where `variety` is None."""

    seed: int
    pictures: int
    variety: "Variety | None" = None
    palette: str | None = None


@dataclass(frozen=True)
class Shard:
    """One file to be made."""

    path: Path
    seed: int
    """Of its first world; the others follow."""
    worlds: int
    """Pictures of worlds."""
    streets: int
    """Pictures of streets."""
    per_world: int
    variety: "Variety"
    palette: str | None

    def sites(self) -> list[Site]:
        """Return what its pictures are of, in their order.

        Streets have seeds of their own, so that no site is a world and a street.
        """
        worlds = enumerate(portions(self.worlds, self.per_world))
        streets = enumerate(portions(self.streets, PER_STREET_SITE))
        return [
            *(Site(self.seed + k, n, self.variety, self.palette) for k, n in worlds),
            *(Site(-self.seed - k, n) for k, n in streets),
        ]


def portions(total: int, most: int) -> list[int]:
    """Return `total` as parts of `most`, the last one perhaps smaller."""
    return [min(most, total - first) for first in range(0, total, most)]


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet dataset synthesise",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pictures", type=int, default=60_000, metavar="N")
    parser.add_argument(
        "--streets", type=float, default=0.25, metavar="SHARE", help="share of street pictures"
    )
    parser.add_argument(
        "--seed", type=int, default=1_000_000, help="from 1000000 on: training, 3000000: figures"
    )
    parser.add_argument("--per-world", type=int, default=PER_WORLD, metavar="N")
    parser.add_argument(
        "--driven", action="store_true", help="uniform along driven paths, looks unvaried: to judge"
    )
    parser.add_argument("--palette", help="for all worlds, for instance `withheld`")
    parser.add_argument("--processes", type=int, default=2)
    varied = parser.add_argument_group("what is varied (ranges as LOW,HIGH)")
    for name in RANGES:
        varied.add_argument("--" + name.replace("_", "-"), metavar="LOW,HIGH")
    for name in NUMBERS:
        varied.add_argument("--" + name.replace("_", "-"), type=float, metavar="X")
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Write the shards and `dataset.json`; 2 for bad arguments."""
    options = arguments(argv)
    with needs_train("juncnet dataset synthesise"):
        from juncnet.learning.datasets import DatasetInfo, write_info
        from juncnet.learning.samples import LABELS
    try:
        shards = list(shards_of(options))
        options.folder.mkdir(parents=True, exist_ok=True)
        _claim(options.folder, _decisive(options, shards[0]))
        _make([shard for shard in shards if not shard.path.exists()], options.processes)
    except (ValueError, OSError) as error:
        print(f"juncnet dataset synthesise: {why(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the same command goes on") from None
    command = ["juncnet", "dataset", "synthesise", options.folder.name]
    command += [word for word in argv if word != str(options.folder)]
    info = DatasetInfo(
        classes=LABELS[:2],
        made_by=shlex.join(command),
        shards=tuple(shard.path.name for shard in shards),
        notes={"variety": shards[0].variety.model_dump_json()},
    )
    write_info(options.folder, info)
    print(f"{options.pictures} pictures in {len(shards)} shards: {options.folder}")
    return 0


def shards_of(options: argparse.Namespace) -> Iterator[Shard]:
    """Yield the files to be made; ValueError: what is wrong with the options."""
    if options.pictures < 1 or not 0 <= options.streets <= 1 or options.per_world < 1:
        raise ValueError("--pictures and --per-world need to be at least 1, --streets 0 to 1")
    variety, left, number = _variety(options), options.pictures, 0
    while left > 0:
        n = min(left, PER_SHARD)
        streets = 0 if options.driven else round(n * options.streets)
        path = options.folder / f"{number:04d}.npz"
        if options.pictures > PER_SHARD and math.ceil((n - streets) / options.per_world) > SEEDS:
            least = math.ceil((n - streets) / SEEDS)
            raise ValueError(
                f"--per-world {options.per_world}: shards would have the same worlds; give "
                f"{least} or more, or several folders with seeds of their own"
            )
        seed = options.seed + number * SEEDS
        yield Shard(path, seed, n - streets, streets, options.per_world, variety, options.palette)
        left, number = left - n, number + 1


def _decisive(options: argparse.Namespace, shard: Shard) -> dict[str, object]:
    """Return all that decides which pictures are made."""
    names = ("pictures", "streets", "seed", "per_world", "driven", "palette")
    given: dict[str, object] = {name: getattr(options, name) for name in names}
    return {**given, "variety": shard.variety.model_dump(mode="json")}


def _claim(folder: Path, decisive: dict[str, object]) -> None:
    """Write into the folder what its pictures are made with.

    Raises:
        ValueError: there are shards that were made with other options, or nobody knows which.
    """
    path = folder / OPTIONS
    if not path.exists() and any(folder.iterdir()) and not any(folder.glob("*.npz")):
        raise ValueError(f"{folder} has other files in it: name a new folder")
    if not any(folder.glob("*.npz")):
        path.write_text(json.dumps(decisive, indent=1) + "\n", encoding="utf-8")
        return
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(
            f"{folder} has shards, and no {OPTIONS} says what they were made with: "
            "name another folder"
        ) from error
    if before != decisive:
        raise ValueError(f"{folder} was made with other options: name another folder")


def _variety(options: argparse.Namespace) -> "Variety":
    from juncnet.learning.synthetic import DRIVEN, Variety
    from juncnet.simulation.palettes import palette_named

    if options.palette:
        palette_named(options.palette)
    values = (DRIVEN if options.driven else Variety()).model_dump()
    for name in RANGES:
        text = getattr(options, name)
        if text is not None:
            low, comma, high = text.partition(",")
            if not comma or float(low) > float(high):
                raise ValueError(f"--{name.replace('_', '-')} {text}: give LOW,HIGH")
            values[name] = (float(low), float(high))
    given = {name: getattr(options, name) for name in NUMBERS}
    values.update({name: value for name, value in given.items() if value is not None})
    return Variety.model_validate(values)


def _make(shards: list[Shard], processes: int) -> None:
    """Make the shards, several sites at a time, with a progress bar."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    total, started = sum(s.worlds + s.streets for s in shards), time.monotonic()
    pool = ProcessPoolExecutor(max(1, processes), initializer=_end_with_the_command)
    with Progress(*columns) as progress, pool:
        task = progress.add_task(f"{total} pictures", total=total)
        made = 0
        try:
            futures = [[pool.submit(make_site, site) for site in shard.sites()] for shard in shards]
            for shard, sites in zip(shards, futures, strict=True):
                for site in sites:
                    made += len(site.result())
                    rate = 60 * made / (time.monotonic() - started)
                    progress.update(task, completed=made, description=f"{rate:.0f} a minute")
                _write(shard, [site.result() for site in sites])
                sites.clear()
        except BaseException:  # interrupted too
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.kill()
            raise


def _end_with_the_command() -> None:
    """End this process with the one that started it: killed, that could not do it itself."""
    parent = multiprocessing.parent_process()

    def end() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def make_site(site: Site) -> "Samples":
    """Return the pictures of one world, or of streets that are drawn by one seed."""
    import cv2

    from juncnet.learning.streets import street_samples
    from juncnet.learning.synthetic import world_samples

    cv2.setNumThreads(1)
    if site.variety is None:
        return street_samples(site.seed, site.pictures)
    return world_samples(site.seed, site.pictures, site.variety, palette=site.palette)


def _write(shard: Shard, sites: list["Samples"]) -> None:
    """Write one shard, at once or not at all."""
    from juncnet.learning.samples import Samples

    part = shard.path.with_suffix(".part.npz")
    Samples.concatenate(sites).save(part)
    part.replace(shard.path)
