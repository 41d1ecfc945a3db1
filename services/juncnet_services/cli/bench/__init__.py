"""`juncnet bench radon|hop|pipeline|...`: measures beside what it is compared with."""

import importlib
import os
import sys

BENCHMARKS = ("radon", "hop", "pipeline", "dashboard", "split", "forwarding")


def main(argv: list[str]) -> int:
    """Run the benchmark named first."""
    if not argv or argv[0] not in BENCHMARKS:
        print(f"usage: juncnet bench {'|'.join(BENCHMARKS)} [--json] ...", file=sys.stderr)
        return 0 if argv and argv[0] in ("-h", "--help") else 2
    # Read when numpy is first imported: the services run with one thread in the matrix library.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    module = importlib.import_module(f"juncnet_services.cli.bench.{argv[0]}")
    return int(module.main(argv[1:]))
