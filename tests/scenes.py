"""Messages, pictures and models that many tests need."""

# pyright: reportUnknownMemberType=false
# (onnx.helper is only partly typed)

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from juncnet.camera import FAR_HEIGHTS, NEAR_ROW
from juncnet.features import Preprocessing
from juncnet.messages import JunctionScore, ModelIdentity, Stamp
from juncnet.modelfile import INPUT, OUTPUT, ModelMetadata

MODEL = ModelIdentity(name="test", sha256="0" * 64)


def stamp(second: float = 1.0, sequence: int | None = None, epoch: int = 1) -> Stamp:
    """Return a stamp of the fake clock; the sequence follows the time unless given."""
    return Stamp(
        epoch=epoch,
        sequence=round(second * 1000) if sequence is None else sequence,
        time_ns=round(second * 1e9),
        clock="fake-clock",
    )


def score(second: float = 1.0, junction: float = 0.0) -> JunctionScore:
    """Return a score with this probability of *junction*."""
    return JunctionScore(
        header=stamp(second),
        model=MODEL,
        probabilities={"none": 1.0 - junction, "junction": junction},
    )


def tiny_model(
    path: Path,
    name: str = "tiny",
    preprocessing: Preprocessing | None = None,
    classes: tuple[str, ...] = ("none", "junction"),
    gain: float = 8.0,
    softmax: bool = True,
) -> Path:
    """Write a model that finds bright pictures to be junctions, and return its path.

    The probability of each class after the first is softmax(gain * (mean of channel 0 - 0.5)).
    """
    preprocessing = preprocessing or Preprocessing(channels=("gray",))
    shape = (len(preprocessing.channels), preprocessing.size, preprocessing.size)
    weights = np.zeros((shape[0], len(classes)), np.float32)
    weights[0, 1:] = gain
    bias = np.zeros(len(classes), np.float32)
    bias[1:] = -gain / 2
    nodes = [
        helper.make_node("ReduceMean", [INPUT], ["mean"], axes=[2, 3], keepdims=0),
        helper.make_node("Gemm", ["mean", "weights", "bias"], ["logits"]),
        helper.make_node("Softmax" if softmax else "Identity", ["logits"], [OUTPUT]),
    ]
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info(INPUT, TensorProto.FLOAT, ["n", *shape])],
        [helper.make_tensor_value_info(OUTPUT, TensorProto.FLOAT, ["n", len(classes)])],
        [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(bias, "bias")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    metadata = ModelMetadata(
        name=name,
        architecture="tiny",
        classes=classes,
        preprocessing=preprocessing,
        near_row=NEAR_ROW,
        far_heights=FAR_HEIGHTS,
    )
    helper.set_model_props(model, metadata.to_properties())
    onnx.save(model, str(path))
    return path
