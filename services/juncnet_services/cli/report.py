"""`juncnet report`: the report of a recorded flight, one HTML file with its pictures beside it."""

import argparse
import json
import sys
from pathlib import Path

from juncnet.recording import MISSING


def main(argv: list[str]) -> int:
    """Write the report; 2 when the recording cannot be used."""
    parser = argparse.ArgumentParser(prog="juncnet report", description=__doc__)
    parser.add_argument("recording", type=Path, help="file, or a folder: its newest recording")
    parser.add_argument("--out", type=Path, help="default: FLIGHT.html beside the recording")
    parser.add_argument("--json", action="store_true", help="print what was written as one object")
    options = parser.parse_args(argv)
    try:
        from juncnet.recording.reader import RecordingError, open_recording
        from juncnet_services.report.write import write_report
    except ImportError as error:
        print(f"juncnet report: {MISSING} ({error})", file=sys.stderr)
        return 2
    try:
        recording = open_recording(options.recording)
        out = options.out or recording.files[0].parent / f"{recording.flight}.html"
        written = write_report(recording, out)
    except (RecordingError, OSError) as error:
        print(f"juncnet report: {error}", file=sys.stderr)
        return 2
    files = [str(path) for path in written]
    print(json.dumps({"report": files[0], "pictures": files[1:]}) if options.json else files[0])
    return 0
