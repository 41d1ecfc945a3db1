"""What the navigator tells: junction events, each numbered and kept, and its state."""

from juncnet.messages import EventKind, JunctionEvent, NavigationState, Stamp, Thresholds, Turn
from juncnet_services.junction_navigation.progress import Progress


class EventLog:
    """The events of a `Progress`: `add` numbers and keeps them, `take` gives what is new."""

    def __init__(self, progress: Progress, resumed: bool) -> None:
        """`resumed`: the latest saved events are new once more, for they may not have left."""
        self._progress = progress
        self._new: list[JunctionEvent] = list(progress.events) if resumed else []

    def add(self, kind: EventKind, header: Stamp | None, turn: Turn) -> None:
        """Note an event of the counted junction; `turn`: what is planned there."""
        state, junction = self._progress, self._progress.junction
        if header is None:
            return
        of_turn = kind in (EventKind.TURN_STARTED, EventKind.TURN_FINISHED)
        self._new.append(
            JunctionEvent(
                header=header,
                flight=state.flight,
                index=state.index,
                kind=kind,
                count=state.count,
                label="junction" if junction is None else junction.label,
                probability=state.smoothed if junction is None else junction.probability,
                turn=turn if of_turn else None,
            )
        )
        state.index += 1

    def take(self) -> tuple[JunctionEvent, ...]:
        """Return what is new since the last call."""
        events, self._new = tuple(self._new), []
        if events:
            self._progress.events = events
        return events


def state_of(
    progress: Progress, header: Stamp | None, thresholds: Thresholds, reason: str
) -> NavigationState:
    """Return the state as it is published; the next turn is one that is still to be made."""
    # The turn at the counted junction is to be made until its road is followed.
    at_junction = int(progress.junction is not None and progress.leave_m is None)
    planned = [t for t in progress.mission.turns if t.at > progress.count - at_junction]
    return NavigationState(
        header=header,
        flight=progress.flight,
        phase=progress.phase,
        count=progress.count,
        mission=progress.mission,
        next_turn=min(planned, key=lambda turn: turn.at, default=None),
        smoothed=progress.smoothed,
        thresholds=thresholds,
        reason=reason,
    )
