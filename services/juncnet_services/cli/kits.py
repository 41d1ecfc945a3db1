"""`juncnet new-follower NAME`, `juncnet new-vehicle NAME`: write a package to begin with."""

import argparse
import sys
from pathlib import Path

from juncnet_services.kits import write_kit


def main(argv: list[str]) -> int:
    """Write the package; 2 when its name or place cannot be used."""
    command, *rest = argv
    kit = command.removeprefix("new-")
    parser = argparse.ArgumentParser(
        prog=f"juncnet {command}", description=f"Writes a package with a {kit}, its test, a README."
    )
    parser.add_argument("name", help="of the package: small letters, digits, _")
    parser.add_argument("--into", type=Path, default=Path(), help="folder (default: here)")
    options = parser.parse_args(rest)
    try:
        written = write_kit(kit, options.name, options.into)
    except FileExistsError:
        print(f"juncnet {command}: {options.into / options.name} is there already", file=sys.stderr)
        return 2
    except (ValueError, OSError) as error:
        print(f"juncnet {command}: {error}", file=sys.stderr)
        return 2
    print("\n".join(str(path) for path in written))
    return 0
