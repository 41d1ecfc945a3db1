"""`juncnet bench radon|hop|pipeline|...`: measures beside what it is compared with."""

import importlib
import os
import sys

BENCHMARKS = {
    "radon": "Radon transform and back-projection beside scikit-image",
    "hop": "a frame and a small message from process to process",
    "pipeline": "picture to command over all processes, beside one process",
    "dashboard": "what dashboard and recorder cost a flight",
    "split": "a flight from another host over a bad link (needs root)",
    "forwarding": "what layout `drone` costs the vehicle's computer",
}


def main(argv: list[str]) -> int:
    """Run the benchmark named first."""
    if not argv or argv[0] not in BENCHMARKS:
        asked = argv[:1] in (["-h"], ["--help"])
        rows = [f"  {name:<11} {text}" for name, text in BENCHMARKS.items()]
        usage = "\n".join(["usage: juncnet bench NAME [--help] ...", "", *rows])
        print(usage, file=sys.stdout if asked else sys.stderr)
        return 0 if asked else 2
    # Read when numpy is first imported: the services run with one thread in the matrix library.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    module = importlib.import_module(f"juncnet_services.cli.bench.{argv[0]}")
    return int(module.main(argv[1:]))
