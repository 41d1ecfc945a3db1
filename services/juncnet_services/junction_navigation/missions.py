"""Reading missions from TOML or JSON."""

import json
import tomllib
from pathlib import Path

from pydantic import ValidationError

from juncnet.assets import asset_path
from juncnet.messages import Mission


def load_mission(mission: str | Path | Mission) -> Mission:
    """Return the mission itself, or that of the file or name given.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no mission; the text names the file and the field.
    """
    if isinstance(mission, Mission):
        return mission
    path = asset_path(mission, "missions", ".toml")
    try:
        text = path.read_text(encoding="utf-8")
        return Mission.model_validate(
            json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "mission"
        raise ValueError(f"{path}: {where}: {first['msg']}, not {first['input']!r:.60}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
