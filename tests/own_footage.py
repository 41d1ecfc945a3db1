"""The way from videos to a flying model, driven once from end to end and judged.

    python tests/own_footage.py --work /tmp/own-footage --fly

Films three junctions and three roads of a town in a style that the default model never saw, takes
at most 1,000 frames to learn from, fine-tunes the default on them and judges both on *other* clips
of the same sites and on *unseen* sites of the town. Then the same with a class for every junction.
What is there already is not made again. Writes models/own-footage.json and .md.
"""

import argparse
import csv
import json
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from juncnet.messages import EventKind
from juncnet_services.cli.closed_loop import SMALL, ClosedLoop
from juncnet_services.cli.demo import prepare
from juncnet_services.cli.provenance import provenance

SEED, PALETTE = 700001, "withheld"
TARGET = 0.9734
MODELS = Path(__file__).parents[1] / "models"
FILM = f"dataset film --seed {SEED} --palette {PALETTE} --height 360 --fps 10"
EXTRACT = "--split-by clip --test '*/day2-*' --shares 70,30,0 --limit 1000"
STEPS = (
    ("own/labels.csv", f"{FILM} --days 3 --out own"),
    (
        "elsewhere/labels.csv",
        f"{FILM} --skip 3 --junctions 4 --first-day 7 --days 1 --out elsewhere",
    ),
    (
        "own-set/dataset.json",
        f"dataset extract own --labels own/labels.csv --out own-set {EXTRACT}",
    ),
    (
        "elsewhere-set/dataset.json",
        "dataset extract elsewhere --labels elsewhere/labels.csv --out elsewhere-set --test '*'",
    ),
    (
        "places-set/dataset.json",
        f"dataset extract own --labels own/places.csv --out places-set {EXTRACT}",
    ),
    ("mine.onnx", "train own-set --from default.onnx --out mine.onnx"),
    (
        "places.onnx",
        "train places-set --from default.onnx --epochs 40 --threads 1 --out places.onnx",
    ),
)
JUDGED = (
    ("default", "own-set", "other clips of the sites, the default as shipped"),
    ("mine", "own-set", "other clips of the sites"),
    ("default", "elsewhere-set", "unseen sites, the default as shipped"),
    ("mine", "elsewhere-set", "unseen sites"),
    ("places", "places-set", "which junction: other clips of the sites"),
)


class Judged(BaseModel):
    """A model on a data set, of what `juncnet evaluate --json` says."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    what: str
    command: str
    model_sha256: str
    protocol: str
    n: int
    accuracy: float
    balanced_accuracy: float
    auc: float
    confusion: list[list[int]]
    classes: list[str]


def run(work: Path, command: str) -> str:
    """Run `juncnet COMMAND` in the work folder, its output shown, and return what it printed."""
    print(f"$ juncnet {command}", flush=True)
    words = [sys.executable, "-c", "from juncnet_services.cli.main import main; main()"]
    done = subprocess.run(
        [*words, *shlex.split(command)], cwd=work, stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"juncnet {command}: exit {done.returncode}\n{done.stdout}")
    return done.stdout


def name_places(work: Path) -> None:
    """Write own/places.csv: own/labels.csv with the site as the class of junctions."""
    with (work / "own/labels.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    label, site = header.index("class"), header.index("site")
    for row in rows:
        row[label] = row[site] if row[label] == "junction" else row[label]
    with (work / "own/places.csv").open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])


def judged(work: Path, model: str, data: str, what: str) -> Judged:
    """Return what `juncnet evaluate` says."""
    command = f"evaluate {model}.onnx {data} --pictures none --out {model}-{data}.json --json"
    command += " --sites unseen" if data == "elsewhere-set" else ""
    said: dict[str, Any] = json.loads(run(work, command))
    return Judged.model_validate({**said, "what": what, "command": f"juncnet {command}"})


def table(rows: list[Judged], found: dict[str, Any]) -> str:
    """Return the figures as Markdown."""
    lines = [
        "# Own footage",
        "",
        f"Three junctions and three plain roads of a simulated town (seed {SEED}) in a style that "
        "the default model never saw, filmed on three simulated days. Learnt from: "
        f"{found['learnt']} frames of the first two days; the third day's clips are the test. "
        "The other sites of the town were never filmed for training.",
        "",
        "| judged on | protocol | frames | accuracy | balanced accuracy | AUC |",
        "|---|---|---|---|---|---|",
    ]
    for r in rows:
        protocol = "no own footage" if "shipped" in r.what else r.protocol
        lines.append(
            f"| {r.what} | {protocol} | {r.n} | {100 * r.accuracy:.2f} % "
            f"| {100 * r.balanced_accuracy:.2f} % | {r.auc:.4f} |"
        )
    reached = "reached" if rows[1].accuracy >= TARGET else "MISSED"
    lines += [
        "",
        f"Target: {100 * TARGET:.2f} % on other clips of the sites (the paper's figure on its own "
        f"data): {reached}. Fine-tuning took {found['training_s']:.0f} s.",
    ]
    if all(rows[i].confusion == rows[i + 1].confusion for i in (0, 2)):
        lines[-1] += " It kept the default as it is: nothing did better on the frames held out."
    for what, f in found.get("flights", {}).items():
        text = (
            f"Flown with {what}.onnx in simulated time, same town and style: *{f['verdict']}*, "
            f"{f['junctions_counted']} of {f['junctions_true']} junctions counted, "
            f"{f['turns_taken']} of {f['turns_planned']} ways right."
        )
        if f["names"]:
            known = [said == true for said, true, is_class in f["names"] if is_class]
            text += (
                f" Of the junctions passed it knows {len(known)}, and {sum(known)} of these events "
                "carried the right name; to strangers it gives the likeliest name that it has."
            )
        lines += ["", text]
    lines += ["", "Made by `" + found["origin"]["command"] + "`, which runs:", ""]
    lines += [f"    juncnet {command}" for _, command in STEPS]
    return "\n".join(lines) + "\n"


def fly(model: Path) -> dict[str, Any]:
    """Fly the town's mission with a model in simulated time; return verdict and junction names.

    `names` has [label of the event, true junction, whether a class is named for it] of every
    junction passed, for a model that tells junctions apart.
    """
    settings = (*SMALL, f'simulator.palette="{PALETTE}"', f'junction_inference.model="{model}"')
    loop = ClosedLoop(prepare("copter", None, SEED, None, settings))
    summary = loop.fly()
    classes = set(loop.model.metadata.classes)
    names: list[tuple[str, str, bool]] = []
    for event in (e for e in loop.trace.events if e.kind is EventKind.ENTERED):
        # The event is told at the mouth: the junction is the next one that the robot is on.
        later = (t for t in loop.trace.truth if t.at.time_ns >= event.header.time_ns)
        node = next((t.junction_id for t in later if t.junction_id is not None), None)
        true = f"junction-{node}"
        if "junction" not in classes:
            names.append((event.label, true, true in classes))
    return {**summary.model_dump(), "names": names}


def main() -> int:
    """Do what is not done yet, judge, and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="for videos and data sets")
    parser.add_argument("--fly", action="store_true", help="fly with the model, too")
    parser.add_argument("--out", type=Path, default=MODELS / "own-footage.json")
    options = parser.parse_args()
    work: Path = options.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    if not (work / "default.onnx").exists():
        shutil.copy(MODELS / "juncnet.onnx", work / "default.onnx")
    times = work / "times.json"
    took: dict[str, float] = json.loads(times.read_text()) if times.exists() else {}
    for made, command in STEPS:
        if made == "places-set/dataset.json":
            name_places(work)
        if not (work / made).exists():
            begun = time.monotonic()
            run(work, command)
            took[made] = time.monotonic() - begun
            times.write_text(json.dumps(took))
    rows = [judged(work, *row) for row in JUDGED]
    with (work / "own-set/samples.csv").open(newline="") as file:
        learnt = sum(row["split"] != "test" for row in csv.DictReader(file))
    found: dict[str, Any] = {"learnt": learnt, "training_s": took.get("mine.onnx", 0.0)}
    if options.fly:
        found["flights"] = {name: fly(work / f"{name}.onnx") for name in ("mine", "places")}
    command = ["python", "tests/own_footage.py", "--work", "DIR", *(["--fly"] * options.fly)]
    found["origin"] = provenance(command).model_dump()
    found["judged"] = [row.model_dump() for row in rows]
    options.out.write_text(json.dumps(found, indent=1) + "\n")
    options.out.with_suffix(".md").write_text(table(rows, found))
    print(table(rows, found))
    return 0 if rows[1].accuracy >= TARGET else 1


if __name__ == "__main__":
    raise SystemExit(main())
