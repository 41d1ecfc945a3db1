"""onnxruntime as JuncNet uses it: one input, one output, one thread, the CPU; typed."""

# onnxruntime leaves its own members without types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray


class Network:
    """A loaded ONNX file. Safe to use from one thread at a time."""

    def __init__(self, data: bytes, threads: int = 1) -> None:
        """Load the ONNX file whose content is `data`.

        Raises:
            ValueError: it is no valid ONNX model.
        """
        options = ort.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = ort.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises a dozen unrelated classes for a bad file
            raise ValueError(f"not a valid ONNX model: {error}") from error

    @property
    def properties(self) -> dict[str, str]:
        """The metadata of the file."""
        return dict(self._session.get_modelmeta().custom_metadata_map)

    def run(
        self, inputs: NDArray[np.float32 | np.uint8], name: str, output: str
    ) -> NDArray[np.float32]:
        """Return the output called `output`, float32, for `inputs` as the input called `name`."""
        (answer,) = self._session.run([output], {name: inputs})
        return np.asarray(answer, dtype=np.float32)
