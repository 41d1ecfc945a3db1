"""What a page offers to swap to."""

import re

from juncnet.assets import asset_path

_NAME = re.compile(rb'\{"name":"([A-Za-z0-9_.:+-]{1,128})","architecture":')
"""How the metadata of a JuncNet model begins (`juncnet.modelfile`); other ONNX files have none."""


def shipped_models() -> list[str]:
    """Return the names of the shipped junction models, as `model/load` can be given them."""
    folder = asset_path("juncnet", "models", ".onnx").parent
    return sorted(path.stem for path in folder.glob("*.onnx") if _NAME.search(path.read_bytes()))
