"""`juncnet new-follower NAME`: writes a package to begin with."""

import argparse
import sys
from pathlib import Path

from juncnet_services.kits import write_kit


def main(argv: list[str]) -> int:
    """Write the package; 2 when its name or place cannot be used."""
    parser = argparse.ArgumentParser(
        prog="juncnet new-follower",
        description="Writes a package with a follower, its test, a README.",
    )
    parser.add_argument("name", help="of the package: small letters, digits, _")
    parser.add_argument("--into", type=Path, default=Path(), help="folder (default: here)")
    options = parser.parse_args(argv)
    try:
        written = write_kit("follower", options.name, options.into)
    except FileExistsError:
        print(
            f"juncnet new-follower: {options.into / options.name} is there already", file=sys.stderr
        )
        return 2
    except (ValueError, OSError) as error:
        print(f"juncnet new-follower: {error}", file=sys.stderr)
        return 2
    print("\n".join(str(path) for path in written))
    return 0
