"""Torch to ONNX, checked against torch before it is believed."""

# Torch and onnx leave these of their own members without types.
# pyright: reportUnknownMemberType=false

import copy
import os
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import nn

from juncnet.inference import Network
from juncnet.learning.weights import pack, round_to_int8
from juncnet.modelfile import INPUT, OUTPUT, ModelMetadata
from juncnet.network import WithSoftmax

TOLERANCE = 1e-4
"""Largest difference allowed between torch's and onnxruntime's probabilities."""
ROUNDING_TOLERANCE = 0.05
"""Largest difference allowed between probabilities before and after rounding weights to int8."""


@dataclass(frozen=True)
class Exported:
    """How closely a file answers as the network does that it was made of."""

    deviation: float
    """Largest difference of a probability between onnxruntime and torch."""
    rounding: float
    """Largest difference that rounding the weights made; 0: they were not rounded."""


def export(network: nn.Module, metadata: ModelMetadata, path: Path, int8: bool = False) -> Exported:
    """Write `network` with softmax and metadata to `path`; an earlier file stays if it is refused.

    Batch normalisation stays unfolded and weights keep their names, so that training can go on
    from the file; onnxruntime folds them when it loads it. With `int8` large weights are rounded
    and stored in a quarter of the bytes.

    Raises:
        ValueError: the file does not answer as torch does within `TOLERANCE`, rounded weights
            answer otherwise than the trained ones, or the answers are no numbers.
    """
    trained = WithSoftmax(network).eval()
    stored = copy.deepcopy(trained)
    if int8:
        round_to_int8(stored)
    part = path.with_name(path.name + ".part")
    try:
        _write(stored, metadata, part, int8)
        exported = _checked(part, trained, stored, _probe(metadata))
        os.replace(part, path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    finally:
        part.unlink(missing_ok=True)
    return exported


def _checked(path: Path, trained: nn.Module, stored: nn.Module, probe: torch.Tensor) -> Exported:
    """Return how closely the file at `path` answers; ValueError as `export`."""
    with torch.no_grad():
        expected, before = stored(probe).numpy(), trained(probe).numpy()
    if not np.isfinite(before).all():
        raise ValueError("the answers are no numbers: train anew with a lower --rate")
    answer = Network(path.read_bytes()).run(probe.numpy(), INPUT, OUTPUT)
    deviation = float(np.abs(answer - expected).max())
    if not deviation <= TOLERANCE:
        raise ValueError(f"onnxruntime deviates from torch by {deviation:.2e}")
    rounding = float(np.abs(before - expected).max())
    if not rounding <= ROUNDING_TOLERANCE:
        raise ValueError(
            f"rounding to int8 changes a probability by {rounding:.2e}: leave out --int8"
        )
    return Exported(deviation, rounding)


def _probe(metadata: ModelMetadata) -> torch.Tensor:
    """Return features of noise, seven pictures."""
    size, channels = metadata.preprocessing.size, len(metadata.preprocessing.channels)
    return torch.rand(7, channels, size, size, generator=torch.Generator().manual_seed(0))


def _write(network: nn.Module, metadata: ModelMetadata, path: Path, int8: bool) -> None:
    with warnings.catch_warnings():
        # The new exporter needs onnxscript; this one is deprecated, and does.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", UserWarning)
        torch.onnx.export(
            network,
            (_probe(metadata),),
            str(path),
            input_names=[INPUT],
            output_names=[OUTPUT],
            dynamic_axes={INPUT: {0: "n"}, OUTPUT: {0: "n"}},
            opset_version=17,
            training=torch.onnx.TrainingMode.PRESERVE,
            do_constant_folding=False,
            dynamo=False,
        )
    model = onnx.load(str(path))
    if int8:
        pack(model)
    onnx.helper.set_model_props(model, metadata.to_properties())
    onnx.save(model, str(path))
