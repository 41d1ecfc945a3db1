"""Torch to ONNX, checked against torch before it is believed."""

# Torch and onnx leave these of their own members without types.
# pyright: reportUnknownMemberType=false

from pathlib import Path

import numpy as np
import onnx
import torch
from torch import nn

from juncnet.inference import Network
from juncnet.modelfile import INPUT, OUTPUT, ModelMetadata
from juncnet.network import WithSoftmax

TOLERANCE = 1e-4
"""Largest difference allowed between torch's and onnxruntime's probabilities."""


def export(network: nn.Module, metadata: ModelMetadata, path: Path) -> float:
    """Write `network` with softmax and metadata to `path`; return the largest deviation from torch.

    Raises:
        ValueError: the file does not answer as torch does within `TOLERANCE`.
    """
    network = WithSoftmax(network).eval()
    size = metadata.preprocessing.size
    probe = torch.rand(
        7,
        len(metadata.preprocessing.channels),
        size,
        size,
        generator=torch.Generator().manual_seed(0),
    )
    torch.onnx.export(
        network,
        (probe,),
        str(path),
        input_names=[INPUT],
        output_names=[OUTPUT],
        dynamic_axes={INPUT: {0: "n"}, OUTPUT: {0: "n"}},
        opset_version=17,
        dynamo=False,
    )
    model = onnx.load(str(path))
    onnx.helper.set_model_props(model, metadata.to_properties())
    onnx.save(model, str(path))
    with torch.no_grad():
        expected = network(probe).numpy()
    answer = Network(path.read_bytes()).run(probe.numpy(), INPUT, OUTPUT)
    deviation = float(np.abs(answer - expected).max())
    if deviation > TOLERANCE:
        raise ValueError(f"{path}: onnxruntime deviates from torch by {deviation:.2e}")
    return deviation
