"""How often progress is saved and the state is told: on every change, and at a steady rate."""

from juncnet_services.junction_navigation.decision import Decision

SAVE_NS = 200_000_000
STATE_NS = 200_000_000


class Pace:
    """Remembers when and what was saved and told last."""

    def __init__(self) -> None:
        self._saved_ns = self._told_ns = -STATE_NS
        self._saved: tuple[object, ...] = ()
        self._told: tuple[object, ...] = ()

    def save_due(self, now_ns: int, decision: Decision) -> bool:
        """Return whether the progress is to be saved now."""
        state = decision.state
        key = (state.phase, state.count, state.mission, bool(decision.events))
        if not decision.events and key == self._saved and now_ns - self._saved_ns < SAVE_NS:
            return False
        self._saved, self._saved_ns = key, now_ns
        return True

    def state_due(self, now_ns: int, decision: Decision) -> bool:
        """Return whether the state is to be published now."""
        state = decision.state
        key = (state.phase, state.count, state.mission, state.reason)
        if key == self._told and now_ns - self._told_ns < STATE_NS:
            return False
        self._told, self._told_ns = key, now_ns
        return True
