"""Judges a junction model on labelled pictures and writes its model card.

python -m juncnet.learning.evaluate models/juncnet.onnx unseen=test.npz withheld=held.npz
"""

import argparse
import hashlib
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from juncnet.features import Extractor
from juncnet.inference import Network
from juncnet.learning.samples import LABELS, Samples
from juncnet.modelfile import INPUT, OUTPUT, ModelMetadata

BOOTSTRAP = 1000


class Figures(BaseModel):
    """How a model does on one set."""

    model_config = ConfigDict(frozen=True)

    name: str
    n: int
    """Pictures outside the transition band."""
    sites: int
    balanced_accuracy: float
    interval: tuple[float, float]
    """95 %, over sites drawn with replacement."""
    recall_junction: float
    recall_none: float
    n_transition: int
    transition_called_junction: float
    """Share of the transition band that is called *junction*: neither right nor wrong."""
    balanced_accuracy_all: float
    """Over all pictures, those of the transition band judged by the ramp's middle."""


def probabilities(model: Path, samples: Samples) -> NDArray[np.float32]:
    """Return the probability of *junction* (N,) that the model file gives each sample."""
    network = Network(model.read_bytes())
    metadata = ModelMetadata.from_properties(network.properties)
    extractor, none = Extractor(metadata.preprocessing), metadata.classes.index("none")
    parts: list[NDArray[np.float32]] = []
    for first in range(0, len(samples), 256):
        features = extractor.batch(samples.gray[first : first + 256])
        parts.append(1 - network.run(features, INPUT, OUTPUT)[:, none])
    return np.concatenate(parts)


def figures(name: str, samples: Samples, probability: NDArray[np.float32]) -> Figures:
    """Return how these probabilities (N,) do on the samples, at a threshold of one half."""
    called = probability >= 0.5
    junction, none, band = (
        samples.label == LABELS.index(k) for k in ("junction", "none", "transition")
    )
    truly = np.where(band, np.nan_to_num(samples.target, nan=0.0) >= 0.5, junction)
    sites = np.unique(samples.site)
    rows = np.array([_counts(samples.site == site, called, junction, none) for site in sites])
    rng = np.random.default_rng(0)
    draws = rows[rng.integers(0, len(sites), (BOOTSTRAP, len(sites)))].sum(axis=1)
    spread = np.percentile([_balanced(*row) for row in draws], [2.5, 97.5])
    right_junction, all_junction, right_none, all_none = rows.sum(axis=0)
    return Figures(
        name=name,
        n=int(junction.sum() + none.sum()),
        sites=len(sites),
        balanced_accuracy=_balanced(*rows.sum(axis=0)),
        interval=(float(spread[0]), float(spread[1])),
        recall_junction=float(right_junction / all_junction),
        recall_none=float(right_none / all_none),
        n_transition=int(band.sum()),
        transition_called_junction=float(called[band].mean()),
        balanced_accuracy_all=float((called[truly].mean() + (~called[~truly]).mean()) / 2),
    )


def _counts(
    here: NDArray[np.bool_],
    called: NDArray[np.bool_],
    junction: NDArray[np.bool_],
    none: NDArray[np.bool_],
) -> tuple[int, int, int, int]:
    return (
        int((here & junction & called).sum()),
        int((here & junction).sum()),
        int((here & none & ~called).sum()),
        int((here & none).sum()),
    )


def _balanced(right_a: float, all_a: float, right_b: float, all_b: float) -> float:
    return float((right_a / max(all_a, 1) + right_b / max(all_b, 1)) / 2)


def card(model: Path, rows: list[Figures], command: str) -> str:
    """Return the model card, Markdown."""
    metadata = ModelMetadata.from_properties(Network(model.read_bytes()).properties)
    p = metadata.preprocessing
    table = "\n".join(
        f"| {r.name} | {r.sites} | {r.n} | {100 * r.balanced_accuracy:.2f} % "
        f"({100 * r.interval[0]:.2f} to {100 * r.interval[1]:.2f}) "
        f"| {100 * r.recall_junction:.2f} % | {100 * r.recall_none:.2f} % | {r.n_transition}: "
        f"{100 * r.transition_called_junction:.0f} % called junction "
        f"| {100 * r.balanced_accuracy_all:.2f} % |"
        for r in rows
    )
    sha256 = hashlib.sha256(model.read_bytes()).hexdigest()
    return f"""# {metadata.name}

Tells *junction* from *none* in a forward camera's picture.

| | |
|---|---|
| file | `{model.name}`, sha256 `{sha256}` |
| architecture | `{metadata.architecture}` in `juncnet/network.py` |
| classes | {", ".join(metadata.classes)} |
| input | {", ".join(p.channels)}; {p.size}x{p.size}, sharpening {p.sharpening}, \
{p.angles} angles, filter {p.filter}, circle {p.circle}, standardisation {p.standardisation} |
| label | mouth between the picture's row {metadata.near_row} and {metadata.far_heights} \
camera heights ahead (`juncnet/camera.py`) |
| recipe | {metadata.recipe} |
| data | pictures of simulated worlds only (`juncnet/learning/synthetic.py`); nobody's photographs |

Frames sampled uniformly along driven paths of worlds that it was not trained on, cameras drawn at
heights of 1.2 to 5 m, pitches of 9 to 26 degrees, fields of view of 68 to 92 degrees. The
transition band (around the first and last distance that counts, and on a junction's surface) is no
part of the balanced accuracy; it stands beside it, and in the last column it is judged as well.
Intervals: 95 %, sites drawn with replacement.

| set | sites | frames | balanced accuracy | junctions found | plain road found | transition \
band | with the band |
|---|---|---|---|---|---|---|---|
{table}

Made by `{command}`.
"""


def main(argv: list[str] | None = None) -> int:
    """Judge and write the card and its figures beside the model."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("sets", nargs="+", metavar="NAME=FILE.npz")
    options = parser.parse_args(argv)
    rows: list[Figures] = []
    for item in options.sets:
        name, _, path = item.partition("=")
        samples = Samples.load(Path(path))
        rows.append(figures(name.replace("_", " "), samples, probabilities(options.model, samples)))
        print(rows[-1].model_dump_json())
    sets = " ".join(f"{s.partition('=')[0]}={Path(s.partition('=')[2]).name}" for s in options.sets)
    command = f"python -m juncnet.learning.evaluate models/{options.model.name} {sets}"
    options.model.with_suffix(".md").write_text(card(options.model, rows, command))
    data = {"command": command, "sets": [row.model_dump() for row in rows]}
    options.model.with_suffix(".json").write_text(json.dumps(data, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
