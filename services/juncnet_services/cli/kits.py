"""`juncnet new-follower NAME`, `juncnet new-vehicle NAME`: write a package to begin with."""

import argparse
import sys
from pathlib import Path

from juncnet_services.kits import write_kit


def main(argv: list[str]) -> int:
    """Write the package that the command, `argv[0]`, names; 2 when its name or place is no good."""
    command, kit = argv[0], argv[0].removeprefix("new-")
    parser = argparse.ArgumentParser(
        prog=f"juncnet {command}",
        description=f"Writes a package with a {kit}, its test, a README.",
    )
    parser.add_argument("name", help="of the package: small letters, digits, _")
    parser.add_argument("--into", type=Path, default=Path(), help="folder (default: here)")
    options = parser.parse_args(argv[1:])
    try:
        written = write_kit(kit, options.name, options.into)
    except FileExistsError:
        where = options.into / options.name
        print(f"juncnet {command}: {where} is there already", file=sys.stderr)
        return 2
    except (ValueError, OSError) as error:
        print(f"juncnet {command}: {error}", file=sys.stderr)
        return 2
    print("\n".join(str(path) for path in written))
    return 0
