"""`juncnet certificates`: makes a CA and one certificate a role, for links over a network.

    juncnet certificates --host drone.local --host 192.168.1.20

makes `certificates/` with a folder a role. Copy `drone/` to the vehicle, `navigation/` to the
laptop, and so on; name the folder as `certificates` in the section [links] of the layout there, or
in $JUNCNET_CERTIFICATES for tools. `authority/` makes more certificates: keep it off every robot.

A further call keeps what is good and makes what is missing or expired; `--renew ROLE` makes one
anew. To shut out a lost computer make all anew (`--new-authority`) and copy it to the others. The
vehicle's names stay.
"""

import argparse
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from juncnet.access import Role
from juncnet.extras import install_command
from juncnet.identity import Identity, IdentityError, read_identity

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
        for line in make(options):
            print(line)
    except ModuleNotFoundError as error:
        print(f"juncnet certificates: {error}: {install_command('certificates')}", file=sys.stderr)
        return 2
    except (ValueError, OSError) as error:
        print(f"juncnet certificates: {error}", file=sys.stderr)
        return 2
    return 0


def make(options: argparse.Namespace) -> Iterator[str]:
    """Make what is missing or of no use any more; yield a line a role.

    Raises:
        ModuleNotFoundError: the extra `certificates` is not installed.
        ValueError: an option is wrong, or the CA is none of ours.
    """
    from juncnet_services.cli.authority import ALWAYS, host_name, issued_hosts, open_authority

    folder: Path = options.folder
    hosts = [host_name(host) for host in options.host]
    if options.days < 1:
        raise ValueError(f"--days {options.days}: must be at least 1")
    kept_hosts = issued_hosts(folder / Role.DRONE)
    if options.new_authority:
        for name in (AUTHORITY, *Role):
            shutil.rmtree(folder / name, ignore_errors=True)
    authority = open_authority(folder / AUTHORITY)
    for role in Role:
        known = _known(folder / role)
        more = role is Role.DRONE and not set(hosts) <= set(kept_hosts)
        if known is None or more or role in options.renew:
            authority.issue(folder / role, role, [*hosts, *kept_hosts], options.days)
        identity = read_identity(folder / role)
        done = "kept" if identity == known else "made"
        named = f", for {', '.join(identity.hosts)}" if identity.hosts else ""
        yield f"{done} {folder / role}: {role} until {identity.ends:%Y-%m-%d}{named}"
        if role is Role.DRONE and set(identity.hosts) <= set(ALWAYS):
            yield (
                f"WARNING: no other host can dial the vehicle, {folder / role} names none under"
                " which it is reached: call again with --host NAME|ADDRESS"
            )


def _known(folder: Path) -> Identity | None:
    """Return the identity that is there; None when there is none that a link would accept."""
    try:
        return read_identity(folder)
    except IdentityError:
        return None
