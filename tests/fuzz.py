"""Malformed inputs for every decoder: `python tests/fuzz.py --inputs 100000 --out FILE`.

Each target of `decoders` gets so many damaged inputs; a fault ends it with the input that made it.
`--guided SECONDS TARGET` searches by coverage instead (`pip install atheris`, Linux); what it finds
stays in `--corpus FOLDER`, where it goes on from.
"""

import argparse
import importlib
import inspect
import json
import random
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from decoders import TARGETS, Target
from juncnet_services.cli.provenance import provenance

GUIDED = (
    "juncnet.frames_wire",
    "juncnet.simulation.link",
    "juncnet_services.command_output.vehicles.arsdk",
    "juncnet_services.command_output.vehicles.bebop_flight",
    "juncnet_services.command_output.vehicles.ros2_link",
    "juncnet_services.frame_capture.h264",
    "juncnet_services.frame_capture.h264_rtp",
    "juncnet_services.frame_capture.rtp",
    "juncnet_services.frame_capture.rtsp",
)
"""Modules whose branches guide the search."""
LONGEST_INPUT = 8192


def attack(target: Target, inputs: int, seed: int) -> dict[str, float]:
    """Return how many of so many damaged inputs were understood, and the time that took.

    Raises:
        Exception: whatever the decoder lets through; a note says which input it was.
    """
    chance, understood, began_s = random.Random(seed), 0, time.process_time()
    for _ in range(inputs):
        data = target.damaged(chance)
        try:
            understood += target.run(data)
        except Exception as error:
            error.add_note(f"input: {data!r}")
            raise
    seconds = time.process_time() - began_s
    return {"inputs": inputs, "understood": understood, "cpu_s": round(seconds, 1)}


def functions(module: ModuleType) -> Iterator[FunctionType]:
    """Yield the functions of a module and the methods of its classes."""
    for found in vars(module).values():
        members = [found, *vars(found).values()] if inspect.isclass(found) else [found]
        for member in members:
            plain = getattr(member, "__func__", member)
            if inspect.isfunction(plain) and plain.__module__ == module.__name__:
                yield plain


def guided(name: str, seconds: int, corpus: Path) -> None:
    """Search inputs of one target for a fault, guided by coverage; ends the process."""
    atheris: Any = importlib.import_module("atheris")
    for module in GUIDED:
        for function in functions(importlib.import_module(module)):
            atheris.instrument_func(function)
    folder = corpus / name
    folder.mkdir(parents=True, exist_ok=True)
    target = TARGETS[name]
    for number, data in enumerate(target.seeds):
        (folder / f"seed-{number}").write_bytes(data)

    def one_input(data: bytes) -> None:
        target.run(data)

    options = [f"-max_total_time={seconds}", f"-max_len={LONGEST_INPUT}", "-print_final_stats=1"]
    options.append(f"-artifact_prefix={folder}/fault-")
    atheris.Setup([sys.argv[0], *options, str(folder)], one_input)
    atheris.Fuzz()


def main(argv: list[str]) -> int:
    """Attack, and print what was measured."""
    parser = argparse.ArgumentParser(prog="python tests/fuzz.py", description=__doc__)
    parser.add_argument("targets", nargs="*", help=f"of {', '.join(TARGETS)}; default: all")
    parser.add_argument("--inputs", type=int, default=100_000, help="for each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="write the figures into this file")
    parser.add_argument("--guided", type=int, metavar="SECONDS", help="by coverage, one target")
    parser.add_argument("--corpus", type=Path, default=Path("fuzz-corpus"))
    options = parser.parse_args(argv)
    unknown = [name for name in options.targets if name not in TARGETS]
    if unknown or (options.guided and len(options.targets) != 1):
        parser.error(f"name one of {', '.join(TARGETS)}")
    if options.guided:
        guided(options.targets[0], options.guided, options.corpus)
    origin = provenance(["python", "tests/fuzz.py", *argv])
    figures: dict[str, object] = {"provenance": origin.model_dump(mode="json")}
    for name in options.targets or TARGETS:
        figures[name] = attack(TARGETS[name], options.inputs, options.seed)
        print(name, figures[name], flush=True)
    if options.out is not None:
        options.out.write_text(json.dumps(figures, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
