"""The training loop: deterministic by seed, and the same whether it was interrupted or not.

Every step draws its chance from (seed, step) alone, so a checkpoint needs no generator's state.
"""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

import math
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from juncnet.features import Extractor
from juncnet.learning.augment import mirror, vary
from juncnet.learning.evaluation.metrics import Ranking
from juncnet.learning.pictures import Pictures
from juncnet.learning.recipes import Recipe
from juncnet.network import RobustNet, WithMask

WARM_UP = 0.1
"""Share of a cycle in which the rate rises."""
JUNCTION_PIXELS = 3.0
"""Weight of a junction's pixels in the mask loss: there are few."""
CHECKPOINT_S = 30.0
REPORTS = 20
"""Points of the curve."""


@dataclass(frozen=True)
class Point:
    """One point of the learning curve."""

    samples: int
    """Pictures seen so far, repetitions counted."""
    loss: float
    """Mean since the point before."""
    balanced_accuracy: float
    """Of the averaged weights, on the validation part."""
    watched_auc: float | None = None
    """Area under the ROC of *any junction* against *none* on watched pictures, if there are any.

    None also where one of both sides has no picture.
    """


class CheckpointError(ValueError):
    """A checkpoint that belongs to another training; the text says what differs."""


class DivergedError(ValueError):
    """A training whose loss is no number any more; the text says what to do."""


class Trainer:
    """Trains `network` in place on `data`, as `recipe` says."""

    def __init__(
        self,
        network: nn.Module,
        data: Pictures,
        validation: Pictures,
        recipe: Recipe,
        seed: int,
        extractor: Extractor,
        watched: Pictures | None = None,
    ) -> None:
        """Prepare; `validation` and `watched` are judged and never trained on.

        `watched` pictures, perhaps from elsewhere, decide nothing; class 0 is *none*.
        """
        self.recipe, self.seed = recipe, seed
        self._data, self._validation, self._extractor = data, validation, extractor
        self._watched = watched
        torch.manual_seed(seed)
        self._inner = network
        self._network = network
        if isinstance(network, RobustNet) and recipe.mask_weight > 0:
            self._network = WithMask(network)
        self._network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]  # torch's stubs lack it
        self.averaged = {k: v.clone() for k, v in network.state_dict().items()}
        """Running average of the weights by name: what is judged and exported."""
        self._start = _fingerprint(self.averaged)
        kind = torch.optim.Adam if recipe.optimiser == "adam" else torch.optim.AdamW
        self._optimiser = kind(
            self._network.parameters(), lr=recipe.rate, weight_decay=recipe.weight_decay
        )
        self._weights = torch.from_numpy(
            data.class_weights if recipe.balanced else np.ones_like(data.target[0])
        )
        self.steps = max(1, math.ceil(recipe.epochs * len(data) / recipe.batch))
        self.step = 0
        self.curve: list[Point] = []
        self._loss_sum = 0.0
        self._best: tuple[float, dict[str, Tensor]] | None = None
        self._epoch, self._order = -1, np.empty(0, np.int64)

    def run(
        self,
        checkpoint: Path | None = None,
        progress: Callable[[int, int, list[Point]], None] | None = None,
        stop: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Train to the end, or until `stop` says so; return whether it reached the end.

        At the end the network holds the averaged weights. With `checkpoint` the state is saved
        there now and then, and at a stop.

        Raises:
            DivergedError: the loss is not finite.
        """
        report = max(1, self.steps // REPORTS)
        if self.recipe.keep_best and not self.curve:
            self._judge()
        saved = time.monotonic()
        while self.step < self.steps:
            self._one_step()
            if self.step % report == 0 or self.step == self.steps:
                self._judge()
            if progress is not None:
                progress(self.step, self.steps, self.curve)
            if checkpoint is not None and time.monotonic() - saved > CHECKPOINT_S:
                self.save(checkpoint)
                saved = time.monotonic()
            if stop():
                break
        if checkpoint is not None:
            self.save(checkpoint)
        if self.step < self.steps:
            return False
        self._inner.load_state_dict(self._best[1] if self._best else self.averaged)
        return True

    def _one_step(self) -> None:
        chosen = self.chosen()
        rng = np.random.default_rng([self.seed, 1, self.step])
        torch.manual_seed(self.seed * 1_000_003 + self.step)
        for group in self._optimiser.param_groups:
            group["lr"] = self.rate()
        loss = self._loss(chosen, rng)
        value = loss.item()
        if not math.isfinite(value):
            raise DivergedError(
                f"the loss is {value} at step {self.step} of {self.steps}: the training diverged; "
                f"train anew with a lower rate than {self.recipe.rate:g} (--rate)"
            )
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()
        self._optimiser.step()
        self.step += 1
        self._loss_sum += value
        self._follow()

    def chosen(self) -> NDArray[np.int64]:
        """Return which pictures this step sees: epochs are shuffled one by one, and joined."""
        n, batch = len(self._data), self.recipe.batch
        first, wanted = self.step * batch, list[NDArray[np.int64]]()
        while sum(map(len, wanted)) < batch:
            at = first + sum(map(len, wanted))
            epoch, begin = divmod(at, n)
            if epoch != self._epoch:
                self._order = np.random.default_rng([self.seed, 0, epoch]).permutation(n)
                self._epoch = epoch
            wanted.append(self._order[begin : begin + batch - sum(map(len, wanted))])
        return np.concatenate(wanted)

    def rate(self) -> float:
        """Return the learning rate of this step."""
        if self.recipe.schedule == "constant":
            return self.recipe.rate
        done = (self.step + 1) / self.steps
        if done < WARM_UP:
            return self.recipe.rate * done / WARM_UP
        return self.recipe.rate * 0.5 * (1 + math.cos(math.pi * (done - WARM_UP) / (1 - WARM_UP)))

    def _loss(self, chosen: NDArray[np.int64], rng: np.random.Generator) -> Tensor:
        gray, target = self._data.gray[chosen], torch.from_numpy(self._data.target[chosen])
        with_masks = isinstance(self._network, WithMask)
        mask = self._data.mask[chosen] if with_masks else None
        if self.recipe.augmentation:
            gray, mask = mirror(gray, mask, rng)
            gray = vary(gray, rng, self.recipe.augmentation)
        self._network.train()
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=self.recipe.bfloat16):
            answer = self._network(features(gray, self._extractor))
        if mask is None:
            return cross_entropy(answer.float(), target, self._weights)
        logits, where = answer
        loss = cross_entropy(logits.float(), target, self._weights)
        known = self._data.masked[chosen]
        if not known.any():
            return loss
        return loss + self.recipe.mask_weight * _mask_loss(where.float()[known], mask[known])

    def _follow(self) -> None:
        """Let the averaged weights follow; early on faster, so that the start is forgotten."""
        decay = min(self.recipe.average, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            for name, value in self._inner.state_dict().items():
                kept = self.averaged[name]
                if self.recipe.average and value.is_floating_point():
                    kept.lerp_(value, 1 - decay)
                else:
                    kept.copy_(value)

    def _judge(self) -> None:
        own = {k: v.clone() for k, v in self._inner.state_dict().items()}
        self._inner.load_state_dict(self.averaged)
        known = self._validation.label >= 0
        answer = predict(self._inner, self._validation.gray[known], self._extractor)
        accuracy = balanced_accuracy(answer, self._validation.label[known])
        auc = self._watched_auc()
        self._inner.load_state_dict(own)
        seen = self.step * self.recipe.batch
        steps = self.step - (self.curve[-1].samples // self.recipe.batch if self.curve else 0)
        self.curve.append(Point(seen, self._loss_sum / max(1, steps), accuracy, auc))
        self._loss_sum = 0.0
        if self.recipe.keep_best and (self._best is None or accuracy > self._best[0]):
            self._best = (accuracy, {k: v.clone() for k, v in self.averaged.items()})

    def _watched_auc(self) -> float | None:
        """Return the area on what is watched; None: nothing is, or one of both sides is empty."""
        if self._watched is None or not (self._watched.label >= 0).any():
            return None
        judged = self._watched.take(np.flatnonzero(self._watched.label >= 0))
        answer = predict(self._inner, judged.gray, self._extractor)
        area = Ranking(1 - answer[:, 0], judged.label > 0).area()
        return area if math.isfinite(area) else None

    def save(self, path: Path) -> None:
        """Write the whole state to `path`, at once or not at all."""
        state: dict[str, Any] = {
            "what": self._identity(),
            "step": self.step,
            "network": self._network.state_dict(),
            "average": self.averaged,
            "optimiser": self._optimiser.state_dict(),
            "curve": [asdict(point) for point in self.curve],
            "loss_sum": self._loss_sum,
            "best": self._best,
        }
        part = path.with_suffix(".part")
        torch.save(state, part)
        os.replace(part, path)

    def resume(self, path: Path) -> None:
        """Go on from the state in `path`.

        Raises:
            CheckpointError: it belongs to another recipe, seed or start, or to other data, or is
                damaged.
        """
        try:
            state = torch.load(path, weights_only=True)
            what: dict[str, str] = dict(state["what"])
        except Exception as error:  # torch raises many classes for a damaged file
            raise CheckpointError(f"{path}: it cannot be read: remove it to start anew") from error
        for name, value in self._identity().items():
            if name not in what:
                raise CheckpointError(
                    f"{path}: an earlier version wrote it and did not say its {name}: "
                    "remove it to start anew"
                )
            if what[name] != value:
                raise CheckpointError(
                    f"{path}: the training there had another {name}: {what[name]} instead of "
                    f"{value}; give the same options and data, or remove it to start anew"
                )
        self.step = int(state["step"])
        self._network.load_state_dict(state["network"])
        self.averaged = state["average"]
        self._optimiser.load_state_dict(state["optimiser"])
        self.curve = [Point(**point) for point in state["curve"]]
        self._loss_sum = float(state["loss_sum"])
        self._best = state.get("best")

    def _identity(self) -> dict[str, str]:
        return {
            "recipe": self.recipe.model_dump_json(),
            "seed": str(self.seed),
            "number of pictures": str(len(self._data)),
            "set of pictures": self._data.fingerprint,
            "validation part": self._validation.fingerprint,
            "start": self._start,
        }


def _fingerprint(weights: dict[str, Tensor]) -> str:
    """Return what tells these weights from others."""
    found = sha256()
    for value in weights.values():
        found.update(value.numpy().tobytes())
    return found.hexdigest()[:16]


def features(gray: NDArray[np.uint8], extractor: Extractor) -> Tensor:
    """Return the network's input (N, C, S, S) of pictures (N, S, S)."""
    return torch.from_numpy(extractor.batch(gray)).contiguous(memory_format=torch.channels_last)


def cross_entropy(logits: Tensor, target: Tensor, weights: Tensor) -> Tensor:
    """Return the mean cross-entropy of logits (N, K) against probabilities (N, K).

    The weights (K,) of the classes count for pictures whose class is sure; in between, where a
    probability is to be learnt, weights would shift it.
    """
    sure = (target.amax(dim=1, keepdim=True) == 1).float()
    weight = sure * weights + (1 - sure)
    return -(weight * target * torch.log_softmax(logits, dim=1)).sum(dim=1).mean()


def _mask_loss(logits: Tensor, mask: NDArray[np.uint8]) -> Tensor:
    """Return the loss of logits (N, 2, 16, 16) against masks (N, M, M), M a multiple of 16."""
    side, step = logits.shape[-1], mask.shape[1] // logits.shape[-1]
    planes = np.stack([mask > 0, mask == 2], axis=1).astype(np.float32)
    share = planes.reshape(len(mask), 2, side, step, side, step).mean(axis=(3, 5))
    weight = torch.tensor([1.0, JUNCTION_PIXELS]).view(2, 1, 1)
    return functional.binary_cross_entropy_with_logits(
        logits, torch.from_numpy(share), pos_weight=weight
    )


@torch.no_grad()
def predict(
    network: nn.Module,
    gray: NDArray[np.uint8],
    extractor: Extractor,
    progress: Callable[[int, int], None] | None = None,
) -> NDArray[np.float32]:
    """Return the probabilities (N, classes) of pictures (N, S, S).

    `progress` is told how many pictures of how many are done.
    """
    network.eval()
    parts: list[NDArray[np.float32]] = []
    for i in range(0, len(gray), 256):
        batch = features(gray[i : i + 256], extractor)
        parts.append(torch.softmax(network(batch), 1).numpy())
        if progress is not None:
            progress(i + len(batch), len(gray))
    return np.concatenate(parts)


def balanced_accuracy(probability: NDArray[np.floating], label: NDArray[np.integer]) -> float:
    """Return the mean recall over the classes that occur, of probabilities (N, classes)."""
    called = probability.argmax(axis=1)
    return float(np.mean([(called[label == k] == k).mean() for k in np.unique(label)]))
