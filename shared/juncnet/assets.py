"""Where models, layouts and missions are: in the installed package, else in the checkout."""

from pathlib import Path

_PACKAGE = Path(__file__).parent / "assets"
CHECKOUT = Path(__file__).parents[2]
_FOLDERS = {
    "models": "models",
    "layouts": "deploy/layouts",
    "missions": "deploy/missions",
    "systemd": "deploy/systemd",
}


def asset(name: str) -> Path:
    """Return the path of an asset such as `layouts/local.toml`.

    Raises:
        FileNotFoundError: there is none of this name; the text says which there are.
    """
    folder, _, rest = name.partition("/")
    places = [_PACKAGE / folder, CHECKOUT / _FOLDERS.get(folder, folder)]
    for place in places:
        if rest and (place / rest).exists():
            return place / rest
    kind = Path(rest).suffix or None
    files = {p for d in places if d.is_dir() for p in d.iterdir() if p.name[0] != "."}
    there = sorted({p.name for p in files if kind in (None, p.suffix)})
    raise FileNotFoundError(f"no {name!r} among {folder}: {', '.join(there) or 'none'}")


def asset_path(name: str | Path, folder: str, suffix: str) -> Path:
    """Return `name` itself if it is a file, else the asset that is called so in short or in full.

    FileNotFoundError, as of `asset`: there is neither.

    `asset_path("local", "layouts", ".toml")` finds `layouts/local.toml`.
    """
    if Path(name).is_file():
        return Path(name)
    name = str(name)
    if name.startswith(("/", ".", "~")):
        raise FileNotFoundError(f"{name}: there is no such file")
    return asset(f"{folder}/{name.removesuffix(suffix).removeprefix(folder + '/')}{suffix}")
