"""`juncnet begin LAYOUT --root DIR`: makes the directory of a new flight, for systemd's units.

`DIR/flight` leads to it. Directories of earlier flights in DIR are removed.
"""

import argparse
import shutil
import sys
from pathlib import Path

from juncnet.assets import asset_path
from juncnet.flight import Flight, new_flight
from juncnet.layout import SAVED, Layout, LayoutError, load_layout

NAME = "flight"


def begin(layout: Layout, root: Path) -> Flight:
    """Make the directory of a new flight of `layout` below `root`, and let `NAME` lead to it."""
    for earlier in root.glob("*/flight.json"):
        if not earlier.parent.is_symlink():
            shutil.rmtree(earlier.parent)
    flight = new_flight(layout.launch.robot, layout.processes, root)
    layout.save(flight.directory / SAVED)
    link = root / f".{NAME}"
    link.unlink(missing_ok=True)
    link.symlink_to(flight.directory.name)
    link.replace(root / NAME)
    return flight


def main(argv: list[str]) -> int:
    """Print the directory of the new flight; 2 when the layout is wrong."""
    parser = argparse.ArgumentParser(prog="juncnet begin", description=__doc__)
    parser.add_argument("layout", help="file or built-in")
    parser.add_argument("--root", type=Path, required=True, help="a private directory")
    options = parser.parse_args(argv)
    try:
        layout = load_layout(asset_path(options.layout, "layouts", ".toml"))
        layout.validate_all()
        print(begin(layout, options.root).directory)
    except (LayoutError, ValueError, OSError) as error:
        print(f"juncnet begin: {error}", file=sys.stderr)
        return 2
    return 0
