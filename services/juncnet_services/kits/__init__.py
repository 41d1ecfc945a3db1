"""Packages that users begin with, and what a driver of theirs is held against.

A kit is a folder of templates: `{name}` and `{class_name}` in its files are replaced, and `NAME` in
their names.
"""

import re
from pathlib import Path

HERE = Path(__file__).parent
NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
SUFFIX = ".template"


def write_kit(kit: str, name: str, folder: Path) -> list[Path]:
    """Write the kit's files for a package called `name` into `folder`/`name`; return them.

    Raises:
        ValueError: the name cannot be a package's.
        FileExistsError: the folder is there already: nothing is overwritten.
    """
    if not NAME.fullmatch(name):
        raise ValueError(f"{name!r}: a package's name has small letters, digits and _ only")
    root = folder / name
    root.mkdir(parents=True)
    class_name = "".join(part.capitalize() for part in name.split("_"))
    written: list[Path] = []
    for source in sorted((HERE / kit).rglob(f"*{SUFFIX}")):
        relative = str(source.relative_to(HERE / kit)).removesuffix(SUFFIX).replace("NAME", name)
        target = root / relative
        target.parent.mkdir(parents=True, exist_ok=True)
        text = source.read_text()
        target.write_text(text.replace("{name}", name).replace("{class_name}", class_name))
        written.append(target)
    return written
