"""`juncnet service install LAYOUT | remove`: systemd units for the processes of a layout.

Installs to /etc/systemd/system, makes the user `juncnet`, writes /etc/juncnet/layout.toml (kept if
it is there: the robot's own options go into it), starts `juncnet.target`, now and at every boot.

    systemctl status 'juncnet@*'        journalctl -f -u 'juncnet@*'
    systemctl restart juncnet.target    a new flight
    sudo -u juncnet PYTHON -m juncnet_services.cli stop --flight /run/juncnet/flight
"""

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import juncnet
from juncnet.access import Role
from juncnet.assets import asset, asset_path
from juncnet.identity import CA, CERTIFICATE, KEY, IdentityError, read_identity
from juncnet.layout import Layout, LayoutError, load_layout

USER = "juncnet"
UNITS = "etc/systemd/system"
SYSUSERS = "etc/sysusers.d/juncnet.conf"
CONFIGURATION = "etc/juncnet"
PROCESSES = f"{UNITS}/juncnet.target.d/processes.conf"
PYTHON = "@PYTHON@"


def unit_files(layout: Layout, python: str) -> Iterator[tuple[str, str]]:
    """Yield path below the root and text of each file that systemd reads."""
    folder = asset("systemd/juncnet.target").parent
    users = folder / "juncnet.sysusers.conf"
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path != users:
            text = path.read_text().replace(PYTHON, python)
            yield f"{UNITS}/{path.relative_to(folder)}", text
    yield SYSUSERS, users.read_text()
    wants = "".join(f"Wants=juncnet@{name}.service\n" for name in layout.processes)
    yield PROCESSES, f"# The processes of {layout.path}.\n[Unit]\n{wants}"


def layout_text(layout: Layout, with_certificates: bool) -> str:
    """Return the text of the robot's own layout file, on top of the one that is installed."""
    links = f'\n[links]\ncertificates = "/{CONFIGURATION}/certificates"\n'
    return (
        "# This robot's own options, on top of those of the layout below:\n"
        "# see deploy/guides/vehicles.md.\n"
        f'extends = "{layout.path.resolve()}"\n' + (links if with_certificates else "")
    )


def _check_base(own: Path, layout: Layout) -> None:
    """LayoutError: the robot's own layout is on top of another one than is asked for."""
    base = _toml(own).get("extends")
    if base is not None and (own.parent / str(base)).resolve() != layout.path.resolve():
        raise LayoutError(
            f"{own} is on top of {base}, not of {layout.path.resolve()}: correct its `extends`,"
            " or remove the file (juncnet service remove --purge)"
        )


def _toml(path: Path) -> dict[str, object]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise LayoutError(f"{path}: {error}") from error


def install(layout: Layout, root: Path, python: str, certificates: Path | None) -> Iterator[Path]:
    """Write all files below `root`, and yield each that was written.

    Raises:
        IdentityError: the certificates cannot be used.
        LayoutError: the robot's own layout file, which is kept, is wrong, or of another layout.
    """
    own = root / CONFIGURATION / "layout.toml"
    if not own.exists():
        yield _write(own, layout_text(layout, certificates is not None))
    _check_base(own, layout)
    for name, text in unit_files(load_layout(own), python):
        yield _write(root / name, text)
    if certificates is not None:
        read_identity(certificates)
        folder = root / CONFIGURATION / "certificates"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for name in (CA, CERTIFICATE, KEY):
            (folder / name).unlink(missing_ok=True)
            (folder / name).touch(mode=0o600)
            (folder / name).write_bytes((certificates / name).read_bytes())
            yield folder / name


def remove(root: Path, purge: bool) -> Iterator[Path]:
    """Remove what `install` wrote and yield it; `purge`: layout, certificates and state too."""
    units = root / UNITS
    for path in (*sorted(units.glob("juncnet[.@-]*")), root / SYSUSERS):
        yield from _remove(path)
    yield from _remove(units / "multi-user.target.wants/juncnet.target")
    if purge:
        yield from _remove(root / CONFIGURATION)
        yield from _remove(root / "var/lib/juncnet")


def out_of_reach(*places: Path) -> Path | None:
    """Return the first of `places` that the user `juncnet` could not read, or None."""
    for place in places:
        for folder in (place, *place.parents):
            if folder.is_dir() and folder.stat().st_mode & 0o005 != 0o005:
                return folder
    return None


def main(argv: list[str]) -> int:
    """Install or remove; 0 done, 1 systemd refused, 2 it cannot be done so."""
    options = arguments(argv)
    root: Path = options.root
    here = root == Path("/")
    try:
        if options.action == "remove":
            if here:
                _systemctl("disable", "--now", "juncnet.target", "juncnet@*.service")
            for path in remove(root, options.purge):
                print(f"removed {path}")
            return _systemctl("daemon-reload") if here else 0
        layout = load_layout(asset_path(options.layout, "layouts", ".toml"))
        closed = out_of_reach(Path(sys.executable), Path(juncnet.__file__)) if here else None
        if closed is not None:
            print(
                f"juncnet service: the user {USER} may not read {closed}: have the checkout in"
                " /opt/juncnet, or its environment elsewhere (JUNCNET_ENV)",
                file=sys.stderr,
            )
            return 2
        for path in install(layout, root, sys.executable, options.certificates):
            print(f"wrote {path}")
    except (LayoutError, IdentityError, OSError) as error:
        print(f"juncnet service: {error}", file=sys.stderr)
        return 2
    return _start(root) if here else 0


def arguments(argv: list[str]) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog="juncnet service",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    actions = parser.add_subparsers(dest="action", required=True)
    adding = actions.add_parser("install", help="write the units and start them")
    adding.add_argument("layout", help="file or built-in: drone, laptop, ...")
    adding.add_argument(
        "--certificates", type=Path, metavar="FOLDER", help=f"copied: {Role.DRONE}/ on a vehicle"
    )
    removing = actions.add_parser("remove", help="stop the units and remove them")
    removing.add_argument("--purge", action="store_true", help="layout, certificates, state too")
    for action in (adding, removing):
        action.add_argument(
            "--root", type=Path, default=Path("/"), metavar="DIR", help="of another system"
        )
    return parser.parse_args(argv)


def _start(root: Path) -> int:
    commands = (
        ["systemd-sysusers", str(root / SYSUSERS)],
        ["chown", "-R", f"{USER}:{USER}", str(root / CONFIGURATION)],
    )
    for command in commands:
        if subprocess.run(command, check=False).returncode:
            return 1
    return _systemctl("daemon-reload") or _systemctl("enable", "--now", "juncnet.target")


def _systemctl(*words: str) -> int:
    return 1 if subprocess.run(["systemctl", *words], check=False).returncode else 0


def _write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def _remove(path: Path) -> Iterator[Path]:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
        yield path
    elif os.path.lexists(path):
        path.unlink()
        yield path
