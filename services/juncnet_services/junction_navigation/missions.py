"""Reading missions from TOML."""

import tomllib

from juncnet.assets import asset_path
from juncnet.messages import Mission


def load_mission(mission: str | Mission) -> Mission:
    """Return the mission itself, or that of the file or name given.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no mission; the text names the field.
    """
    if isinstance(mission, Mission):
        return mission
    text = asset_path(mission, "missions", ".toml").read_text()
    return Mission.model_validate(tomllib.loads(text))
