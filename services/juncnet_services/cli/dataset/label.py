"""`juncnet dataset label VIDEO...`: say what videos show, with one key a class, in a browser.

Serves a page on this host only and prints its address. Every key is saved at once: quit or crash as
you like, the same command goes on where you were. --out is the interval file that
`juncnet dataset extract --labels` reads.

On a robot or server without a screen: `ssh -L 8090:127.0.0.1:8090 HOST` and --port 8090, then open
the address on your own machine.
"""

import argparse
import os
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path

from juncnet.learning.footage.intervals import FootageError, check_name
from juncnet_services.cli.dataset.clips import site_of
from juncnet_services.cli.dataset.label_server import LabelServer
from juncnet_services.cli.dataset.labelling import Labelling
from juncnet_services.cli.dataset.videos import Video, clip_names, videos_in
from juncnet_services.cli.ranges import port

MOST_CLASSES = 9


def session_of(
    paths: Sequence[Path], classes: str, out: Path, site_pattern: str | None
) -> Labelling:
    """Return the session of these videos, or of all in the folders among them.

    Raises:
        FootageError: a video cannot be read, the classes make no sense, or the journal is damaged.
    """
    names = tuple(name.strip() for name in classes.split(",") if name.strip())
    if "none" not in names or not 2 <= len(names) <= MOST_CLASSES or len(set(names)) < len(names):
        raise FootageError(
            f"--classes {classes!r}: name two to {MOST_CLASSES} different ones, "
            "one of them `none` (plain road)"
        )
    for name in names:
        check_name(name)
    files = [file for p in paths for file in (videos_in(p) if p.is_dir() else [p])]
    clips = clip_names(files, out.parent)
    sites = {
        name: site_of(name, site_pattern, path.parent.name if "/" in name else path.stem)
        for name, path in clips.items()
    }
    videos = {name: Video(path) for name, path in clips.items()}
    return Labelling(videos, names, out, sites)


def main(argv: list[str]) -> int:
    """Serve the page until interrupted; 2 when something given is wrong."""
    options = _parser().parse_args(argv)
    out: Path = options.out or _usual_out(options.videos[0])
    try:
        session = session_of(options.videos, options.classes, out, options.site_from)
    except FootageError as error:
        print(f"juncnet dataset label: {error}", file=sys.stderr)
        return 2
    try:
        server = LabelServer(session, options.port)
    except OSError as error:
        print(f"juncnet dataset label: port {options.port}: {error.strerror}", file=sys.stderr)
        return 2
    print(f"{'going on with' if session.resumed else 'labels go to'} {out}")
    print(f"open {server.url}  (end with Ctrl+C)", flush=True)
    if options.open or (options.open is None and _has_display()):
        webbrowser.open(server.url)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        print(f"\nlabels are in {out}: `juncnet dataset extract {out.parent} --labels {out} ...`")
    finally:
        server.server_close()
        session.close()
    return 0


def _usual_out(first: Path) -> Path:
    return (first if first.is_dir() else first.parent) / "labels.csv"


def _has_display() -> bool:
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="juncnet dataset label",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("videos", nargs="+", type=Path, metavar="VIDEO", help="videos, or folders of videos")
    add("--classes", default="none,junction", help="in the order of the keys 1, 2, ...")
    add("--out", type=Path, metavar="FILE", help="(default: labels.csv beside the videos)")
    add("--site-from", metavar="REGEX", help="its first group in a clip's name is the clip's site")
    add("--port", type=port, default=0, help="of the page (any free one)")
    add("--open", action=argparse.BooleanOptionalAction, help="open a browser (where there is one)")
    return parser
