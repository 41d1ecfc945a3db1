"""`juncnet compare DATA`: the paper's Table IV on your own pictures.

Trains kNN, SVM, 1-CNN/2-FCN, AlexNet, VGG and JuncNet (the paper's recipe, tuned, robust) on the
same pictures and tests them on unseen sites, on seen sites (the paper's protocol) and on any
further set. Writes models/compare-DATA.json, .md and .png after each of them.
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
    options = table_parser("compare", __doc__).parse_args(argv)
    return make_table("compare", options, _plan)


def _plan(options: argparse.Namespace) -> Plan:
    from juncnet.learning.evaluation.compare_report import markdown
    from juncnet.learning.evaluation.contestants import NAMES

    def begin(parts: "Parts", sets: "Mapping[str, Dataset]") -> MakeEntry:
        from juncnet.features import Preprocessing
        from juncnet.learning.evaluation.compare import columns_of, compete
        from juncnet.learning.pictures import prepared

        judged = (parts.train, parts.validation)
        train, validation = (prepared([part], Preprocessing()) for part in judged)
        columns = columns_of(sets, parts.train.classes, Preprocessing())
        return lambda name, budget: compete(name, train, validation, columns, budget)

    return Plan(NAMES, begin, markdown, "Table IV")
