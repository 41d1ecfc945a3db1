"""Messages and pictures that many tests need."""

from juncnet.messages import JunctionScore, ModelIdentity, Stamp

MODEL = ModelIdentity(name="test", sha256="0" * 64)


def stamp(second: float = 1.0, sequence: int | None = None, epoch: int = 1) -> Stamp:
    """Return a stamp of the fake clock; the sequence follows the time unless given."""
    return Stamp(
        epoch=epoch,
        sequence=round(second * 1000) if sequence is None else sequence,
        time_ns=round(second * 1e9),
        clock="fake-clock",
    )


def score(second: float = 1.0, junction: float = 0.0) -> JunctionScore:
    """Return a score with this probability of *junction*."""
    return JunctionScore(
        header=stamp(second),
        model=MODEL,
        probabilities={"none": 1.0 - junction, "junction": junction},
    )
