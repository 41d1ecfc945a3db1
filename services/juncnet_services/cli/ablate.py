"""`juncnet ablate DATA`: what each step of the preprocessing is worth on your own pictures.

Trains the same network on the same pictures with one step changed at a time: grayscale only, Radon
only, sharpening, angles, filter, size, circle, standardisation. Tests on unseen sites, on seen
sites and on any further set. Writes models/ablate-DATA-PRESET.json, .md and .png after each.
"""

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

from juncnet_services.cli.trained_table import MakeEntry, Plan, make_table, table_parser

if TYPE_CHECKING:
    from juncnet.learning.datasets import Dataset
    from juncnet.learning.evaluation.protocols import Parts


def main(argv: list[str]) -> int:
    """Train, test and write; 2 for bad arguments or data."""
    parser = table_parser("ablate", __doc__)
    parser.add_argument(
        "--preset",
        choices=("tuned", "robust"),
        default="tuned",
        help="tuned: the paper's network (default); robust: the better one, 64x64 only",
    )
    return make_table("ablate", parser.parse_args(argv), _plan)


def _plan(options: argparse.Namespace) -> Plan:
    from juncnet.learning.evaluation.ablation import Subject, ablate, markdown, variants

    def begin(parts: "Parts", sets: "Mapping[str, Dataset]") -> MakeEntry:
        subject = Subject(options.preset, parts, sets)
        return lambda name, budget: ablate(name, subject, budget)

    title = f"Preprocessing, preset {options.preset}"
    return Plan(tuple(variants(options.preset)), begin, markdown, title)
