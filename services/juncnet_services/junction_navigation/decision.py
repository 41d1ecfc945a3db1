"""What a step of the navigator came to."""

from dataclasses import dataclass

from juncnet.messages import JunctionEvent, NavigationState, Stamp, Velocity


@dataclass(frozen=True)
class Decision:
    """What a step of the navigator came to."""

    header: Stamp | None
    """Of the newest frame that it rests on; None before the first."""
    velocity: Velocity
    state: NavigationState
    events: tuple[JunctionEvent, ...] = ()
    """To be published once `Navigator.progress` has been saved."""
    refused: tuple[str, ...] = ()
    """Inputs that were not obeyed, and why."""
