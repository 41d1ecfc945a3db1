"""The weights inside an ONNX file: read back for further training, and stored in fewer bytes."""

# onnx leaves these of its own members without types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from torch import nn

PACKED, SCALE = "/int8", "/scale"
"""Ends of the names of a packed weight's two arrays in the file."""
WORTH_PACKING = 4096
"""Weights of fewer numbers stay float32."""


class WeightsError(ValueError):
    """A file's weights do not fit the network; the text says why and what to do."""


def round_to_int8(network: nn.Module) -> None:
    """Round the large weights of `network`, in place, to 255 steps an output channel."""
    with torch.no_grad():
        for weight in _large(network).values():
            scale = _scale(weight.numpy())
            steps = np.rint(weight.numpy() / scale)
            weight.copy_(torch.from_numpy((steps * scale).astype(np.float32)))


def _large(network: nn.Module) -> dict[str, torch.Tensor]:
    found = network.state_dict().items()
    return {k: v for k, v in found if v.dim() > 1 and v.numel() >= WORTH_PACKING}


def _scale(weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the step of each output channel, shaped to divide `weight`."""
    largest = np.abs(weight).max(axis=tuple(range(1, weight.ndim)), keepdims=True)
    return np.maximum(largest / 127.0, 1e-12).astype(np.float32)


def pack(model: onnx.ModelProto) -> None:
    """Store the large weights of `model`, in place, as int8 and a scale for each output channel.

    The file multiplies them back to float32 when it is loaded. Nothing is lost if the network was
    rounded by `round_to_int8` before it was exported.
    """
    graph = model.graph
    unpacking: list[onnx.NodeProto] = []
    for tensor in list(graph.initializer):
        weight = numpy_helper.to_array(tensor)
        if weight.ndim < 2 or weight.size < WORTH_PACKING or weight.dtype != np.float32:
            continue
        name, scale = tensor.name, _scale(weight)
        steps = np.rint(weight / scale).astype(np.int8)
        graph.initializer.remove(tensor)
        graph.initializer.append(numpy_helper.from_array(steps, name + PACKED))
        graph.initializer.append(numpy_helper.from_array(scale, name + SCALE))
        unpacking += [
            helper.make_node("Cast", [name + PACKED], [name + "/float"], to=TensorProto.FLOAT),
            helper.make_node("Mul", [name + "/float", name + SCALE], [name]),
        ]
    nodes = [*unpacking, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)


def read_weights(path: Path) -> dict[str, NDArray[np.float32]]:
    """Return the arrays of an exported network by their names in torch, packed ones unpacked.

    Raises:
        WeightsError: it is no ONNX file.
    """
    try:
        graph = onnx.load(str(path)).graph
    except Exception as error:  # protobuf raises classes of its own for a bad file
        raise WeightsError(f"{path}: not a readable ONNX file: {error}") from error
    arrays = {tensor.name: numpy_helper.to_array(tensor) for tensor in graph.initializer}
    for name in [name for name in arrays if name.endswith(PACKED)]:
        plain = name.removesuffix(PACKED)
        arrays[plain] = (arrays.pop(name) * arrays.pop(plain + SCALE)).astype(np.float32)
    for node in graph.node:  # equal arrays are stored once
        if node.op_type == "Identity" and node.input[0] in arrays:
            arrays[node.output[0]] = arrays[node.input[0]]
    return {name.removeprefix("network."): array for name, array in arrays.items()}


def start_from(network: nn.Module, path: Path, same_classes: bool) -> None:
    """Give `network` the weights of an exported one; its last layer only with `same_classes`.

    Raises:
        WeightsError: the file was exported from another architecture, or without its weights.
    """
    found = read_weights(path)
    wanted = network.state_dict()
    last = [name.rpartition(".")[0] for name in wanted][-1]
    for name, value in wanted.items():
        if name.endswith("num_batches_tracked") or (
            not same_classes and name.rpartition(".")[0] == last
        ):
            continue
        if name not in found or found[name].shape != tuple(value.shape):
            raise WeightsError(
                f"{path}: it holds no weights {name} of shape {tuple(value.shape)}: "
                "start from a model of the same architecture, exported by `juncnet train`"
            )
        value.copy_(torch.from_numpy(found[name].copy()))
