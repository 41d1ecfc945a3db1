"""Reading missions from TOML."""

import tomllib
from pathlib import Path

import juncnet
from juncnet.messages import Mission


def mission_path(name: str) -> Path:
    """Return the file of a mission: a path, or the name of one that comes with JuncNet.

    Raises:
        FileNotFoundError: there is none; the text names the places looked at.
    """
    package = Path(juncnet.__file__).parent
    places = (
        Path(name),
        package / "assets" / "missions" / f"{name}.toml",
        package.parents[1] / "deploy" / "missions" / f"{name}.toml",
    )
    for place in places:
        if place.is_file():
            return place
    raise FileNotFoundError(f"no mission {name!r}: looked at {', '.join(map(str, places))}")


def load_mission(mission: str | Mission) -> Mission:
    """Return the mission itself, or that of the file or name given.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is no mission; the text names the field.
    """
    if isinstance(mission, Mission):
        return mission
    return Mission.model_validate(tomllib.loads(mission_path(mission).read_text()))
