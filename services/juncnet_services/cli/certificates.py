"""`juncnet certificates`: makes a CA and one certificate a role, for links over a network.

    juncnet certificates --host drone.local --host 192.168.1.20

makes `certificates/` with a folder a role. Copy `drone/` to the vehicle, `navigation/` to the
laptop, and so on; name the folder as `certificates` in the section [links] of the layout there, or
in $JUNCNET_CERTIFICATES for tools. `authority/` makes more certificates: keep it off every robot.

A further call keeps what is there and makes what is missing; `--renew ROLE` makes one anew. To shut
out a lost computer make everything anew (`--new-authority`) and copy it to the others.
"""

import argparse
import shutil
import sys
from pathlib import Path

from juncnet.access import Role
from juncnet.identity import CERTIFICATE, IdentityError, read_identity

AUTHORITY = "authority"
DAYS = 365


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet certificates",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path("certificates"), help="(certificates)"
    )
    parser.add_argument(
        "--host",
        action="append",
        default=[],
        metavar="NAME|ADDRESS",
        help="under which the vehicle is dialled; repeatable (localhost is always one)",
    )
    parser.add_argument(
        "--renew", action="append", default=[], choices=list(Role), help="make this one anew"
    )
    parser.add_argument(
        "--new-authority", action="store_true", help="make all anew: those before count no more"
    )
    parser.add_argument(
        "--days", type=int, default=DAYS, help=f"how long certificates are valid ({DAYS})"
    )
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Make what is missing and list what is there; 2 when it cannot be made."""
    options = arguments(argv)
    try:
        from juncnet_services.cli.authority import Authority, open_authority
    except ModuleNotFoundError as error:
        print(
            f"juncnet certificates: {error}: pip install 'juncnet[certificates]'", file=sys.stderr
        )
        return 2
    folder: Path = options.folder
    try:
        if options.new_authority:
            for name in (AUTHORITY, *Role):
                shutil.rmtree(folder / name, ignore_errors=True)
        authority: Authority = open_authority(folder / AUTHORITY)
        for role in Role:
            stale = role in options.renew or (
                role is Role.DRONE and _other_hosts(folder, options.host)
            )
            if stale or not (folder / role / CERTIFICATE).exists():
                authority.issue(folder / role, role, options.host, options.days)
        for role in Role:
            identity = read_identity(folder / role)
            named = f" for {', '.join(identity.hosts)}" if identity.hosts else ""
            print(f"{folder / role}: {role} until {identity.ends:%Y-%m-%d}{named}")
    except (IdentityError, ValueError, OSError) as error:
        print(f"juncnet certificates: {error}", file=sys.stderr)
        return 2
    return 0


def _other_hosts(folder: Path, hosts: list[str]) -> bool:
    """Return whether the vehicle's certificate lacks any of `hosts`."""
    try:
        known = read_identity(folder / Role.DRONE).hosts
    except IdentityError:
        return False
    return not set(hosts) <= set(known)
