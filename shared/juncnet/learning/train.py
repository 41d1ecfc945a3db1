"""Trains a junction network on labelled pictures and exports it to ONNX.

python -m juncnet.learning.train DATA.npz ... --validation VAL.npz --out models/juncnet.onnx
"""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

import argparse
import math
import time
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from juncnet.camera import FAR_HEIGHTS, NEAR_ROW
from juncnet.features import Extractor, Preprocessing
from juncnet.learning.export import export
from juncnet.learning.samples import Samples
from juncnet.modelfile import ModelMetadata
from juncnet.network import Architecture, build, parameters


def augment(gray: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return pictures (N, S, S) of random mirror, contrast, brightness, gamma, shade, noise."""
    n = len(gray)
    x = gray.astype(np.float32) / 255.0
    mirrored = rng.random(n) < 0.5
    x[mirrored] = x[mirrored, :, ::-1]
    shape = (n, 1, 1)
    x **= np.exp(rng.normal(0, 0.25, shape)).astype(np.float32)
    x = (x - 0.5) * rng.uniform(0.6, 1.3, shape).astype(np.float32) + 0.5
    x += rng.uniform(-0.12, 0.12, shape).astype(np.float32)
    ramp = np.linspace(-1, 1, gray.shape[1], dtype=np.float32)
    x += rng.normal(0, 0.05, shape).astype(np.float32) * ramp[None, :, None]
    x += rng.normal(0, 0.05, shape).astype(np.float32) * ramp[None, None, :]
    x += rng.standard_normal(x.shape, np.float32) * rng.uniform(0, 0.03, shape).astype(np.float32)
    return (np.clip(x, 0, 1) * 255.0 + 0.5).astype(np.uint8)


def balanced_accuracy(probability: NDArray[np.floating], label: NDArray[np.uint8]) -> float:
    """Return the mean of the recalls of *none* and *junction* at a threshold of 0.5."""
    recalls = [float(((probability >= 0.5) == bool(cls))[label == cls].mean()) for cls in (0, 1)]
    return sum(recalls) / 2


@torch.no_grad()
def predict(network: nn.Module, samples: Samples, extractor: Extractor) -> NDArray[np.float32]:
    """Return the probability of *junction* (N,) of each sample."""
    network.eval()
    parts = [
        torch.softmax(network(_features(samples.gray[i : i + 256], extractor)), 1)[:, 1].numpy()
        for i in range(0, len(samples), 256)
    ]
    return np.concatenate(parts)


def _features(gray: NDArray[np.uint8], extractor: Extractor) -> Tensor:
    return torch.from_numpy(extractor.batch(gray)).contiguous(memory_format=torch.channels_last)


def soft_cross_entropy(logits: Tensor, target: Tensor) -> Tensor:
    """Return the cross-entropy against the probability (N,) of class 1."""
    log_p = torch.log_softmax(logits, dim=1)
    return -(target * log_p[:, 1] + (1 - target) * log_p[:, 0]).mean()


def fit(
    network: nn.Module,
    data: Samples,
    validation: Samples,
    extractor: Extractor,
    *,
    epochs: float,
    batch: int = 128,
    rate: float = 2e-3,
    seed: int = 0,
) -> list[dict[str, float]]:
    """Train `network` in place with Adam, a warm-up and a cosine to zero; return the curve."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]  # torch's stubs lack it
    optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=1e-3)
    steps = int(epochs * len(data) / batch)
    curve: list[dict[str, float]] = []
    order = np.empty(0, np.int64)
    started, loss_sum = time.monotonic(), 0.0
    judged = validation.where(validation.label < 2)
    report = max(steps // 12, 1)
    for step in range(1, steps + 1):
        if len(order) < batch:
            order = rng.permutation(len(data))
        chosen, order = order[:batch], order[batch:]
        progress = step / steps
        for group in optimiser.param_groups:
            group["lr"] = rate * min(step / 200, 0.5 * (1 + math.cos(math.pi * progress)))
        network.train()
        logits = network(_features(augment(data.gray[chosen], rng), extractor))
        loss = soft_cross_entropy(logits, torch.from_numpy(data.target[chosen]))
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        loss_sum += loss.item()
        if step % report == 0 or step == steps:
            accuracy = balanced_accuracy(predict(network, judged, extractor), judged.label)
            point = {
                "samples": float(step * batch),
                "loss": loss_sum / report,
                "balanced_accuracy": accuracy,
            }
            curve.append(point)
            loss_sum = 0.0
            print(
                f"{step}/{steps} steps, {time.monotonic() - started:.0f} s, "
                f"loss {point['loss']:.4f}, balanced accuracy {100 * accuracy:.2f} %",
                flush=True,
            )
    return curve


def main(argv: list[str] | None = None) -> int:
    """Train from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="+", type=Path)
    parser.add_argument("--validation", type=Path, required=True)
    parser.add_argument("--architecture", choices=("paper", "robust"), default="robust")
    parser.add_argument("--epochs", type=float, default=4)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--name", default="juncnet")
    parser.add_argument("--preprocessing", default="{}", help="as JSON; the paper's by default")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(argv)
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    preprocessing = Preprocessing.model_validate_json(options.preprocessing)
    extractor = Extractor(preprocessing)
    data = Samples.concatenate([Samples.load(p) for p in options.data])
    data = data.where(np.isfinite(data.target))
    architecture: Architecture = options.architecture
    network = build(architecture, channels=len(preprocessing.channels))
    print(f"{len(data)} samples, {parameters(network)} weights", flush=True)
    fit(
        network,
        data,
        Samples.load(options.validation),
        extractor,
        epochs=options.epochs,
        rate=options.rate,
        seed=options.seed,
    )
    recipe = (
        f"AdamW, {options.rate}, cosine, batches of 128, {options.epochs} epochs of "
        f"{len(data)} synthetic pictures, seed {options.seed}"
    )
    metadata = ModelMetadata(
        name=options.name,
        architecture=architecture,
        classes=("none", "junction"),
        preprocessing=preprocessing,
        near_row=NEAR_ROW,
        far_heights=FAR_HEIGHTS,
        recipe=recipe,
    )
    deviation = export(network, metadata, options.out)
    print(f"wrote {options.out}; onnxruntime deviates from torch by {deviation:.1e}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
