"""What the ground truth says of a recorded flight, where there is any."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from juncnet_services.cli.judge import MAX_OFF_ROAD_M, ways_right
from juncnet_services.report.flight_data import FlightData


@dataclass(frozen=True)
class Verdict:
    """A sentence, and figures (name, value) for the head of the report."""

    sentence: str
    figures: tuple[tuple[str, str], ...] = ()


def verdict(data: FlightData, planned: Sequence[int] = ()) -> Verdict:
    """Return how count, turns and path were held against the truth; or that there is none.

    `planned`: the directed roads that the mission asks for, where the world is known.
    """
    if not data.truths:
        return Verdict("There is no ground truth in this recording.")
    truths = [truth for _, truth in data.truths]
    passed = truths[-1].junctions_passed
    off_m = max(truth.off_road_m for truth in truths)
    collided = sum(b.collided and not a.collided for a, b in pairwise(truths))
    wrong = data.counted - passed
    count = "exact" if wrong == 0 else f"wrong by {wrong:+d}"
    kept = "stayed on the road" if off_m <= MAX_OFF_ROAD_M else f"left the road by {off_m:.1f} m"
    figures = [("passed in truth", str(passed)), ("furthest off the road", f"{off_m:.2f} m")]
    ways = ""
    if len(planned) > 1:
        right = f"{ways_right(planned, truths[-1].path)} of {len(planned) - 1}"
        ways = f" {right} junctions were left by the planned road,"
        figures.insert(0, ("ways right", right))
    sentence = f"Against the ground truth: the count is {count},{ways} the vehicle {kept}"
    sentence += f", {collided} collisions." if collided else "."
    return Verdict(sentence, tuple(figures))
