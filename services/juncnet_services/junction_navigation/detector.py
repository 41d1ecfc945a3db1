"""From junction probabilities to junctions: smoothing, hysteresis, and which one it is."""

import math

from juncnet.camera import JunctionBand
from juncnet.messages import Thresholds
from juncnet_services.junction_navigation.config import DetectorConfig
from juncnet_services.junction_navigation.place import mouth_m
from juncnet_services.junction_navigation.progress import Junction, Progress

MAX_STEP_S = 0.5
SINKING_NS = 1_000_000_000
"""A score that fell had been sinking for no longer than this."""


class JunctionDetector:
    """Keeps what a `Progress` and its junctions know of the score up to date."""

    def __init__(self, config: DetectorConfig, band: JunctionBand, progress: Progress) -> None:
        self.config, self.band = config, band
        self._progress = progress
        self._newest_ns: int | None = None
        self.rise_lag_s = config.smoothing_s * math.log(1 / (1 - config.enter))
        """How much later than a step of the score the smoothed score rises."""
        self.fall_lag_s = 0.0
        """How much earlier than it was told the last fall was: half-way from where the score was
        last certain to where it went below what it rises at, and as much as the smoothing delays
        that. Some scores linger before they fall."""
        self._certain_ns: int | None = None
        self._sank_ns: int | None = None
        self.thresholds = Thresholds(enter=config.enter, certain=config.certain, leave=config.leave)
        """What decides, as it is told to whoever watches."""

    @property
    def confirm_m(self) -> float:
        """Distance that a risen score must last."""
        return self.config.confirm_fraction * (self.band.d_far_m - self.band.d_near_m)

    def smooth(self, time_ns: int, probability: float) -> bool | None:
        """Take the probability of a frame; True: the score has risen, False: fallen, None: neither.

        The weight of a frame is its share of time, so a dropped frame changes nothing. The longest
        share is `MAX_STEP_S`.
        """
        state = self._progress
        if self._newest_ns is None:
            elapsed_s = 0.04
        else:
            elapsed_s = min(max(time_ns - self._newest_ns, 0) / 1e9, MAX_STEP_S)
        self._newest_ns = time_ns
        weight = 1 - math.exp(-elapsed_s / self.config.smoothing_s)
        state.smoothed += weight * (probability - state.smoothed)
        state.smoothed = min(max(state.smoothed, 0.0), 1.0)
        self._watch_sinking(time_ns)
        if state.high == (state.smoothed > self.threshold):
            return None
        state.high = not state.high
        return state.high

    def _watch_sinking(self, time_ns: int) -> None:
        smoothed = self._progress.smoothed
        if not self._progress.high:
            self._certain_ns = self._sank_ns = None
            return
        if smoothed >= self.config.certain:
            self._certain_ns = time_ns
        if smoothed > self.config.enter:
            self._sank_ns = None
            return
        if self._sank_ns is None:
            certain_ns = time_ns if self._certain_ns is None else self._certain_ns
            self._sank_ns = (max(certain_ns, time_ns - SINKING_NS) + time_ns) // 2
        delay_s = self.config.smoothing_s * math.log(1 / self.config.enter)
        self.fall_lag_s = (time_ns - self._sank_ns) / 1e9 + delay_s

    @property
    def threshold(self) -> float:
        """What the smoothed probability must cross next."""
        return self.config.leave if self._progress.high else self.config.enter

    def risen(self, at_m: float, label: str) -> None:
        """Note that the score rose at an odometer reading."""
        state = self._progress
        passed = None if state.turned is not None else state.junction
        for known in (state.candidate, passed):
            if known is not None and known.fall_m is not None and self._dipped(known, at_m):
                known.fall_m = None
                return
        ahead = state.junction
        if ahead is not None and not ahead.rise_seen and at_m < mouth_m(ahead, self.band, at_m):
            # A junction that was counted because its opening was seen before the score rose.
            ahead.rise_m, ahead.rise_seen, ahead.fall_m, ahead.label = at_m, True, None, label
        elif state.candidate is None:
            state.candidate = Junction(rise_m=at_m, label=label)

    def fallen(self, at_m: float) -> None:
        """Note that the score fell at an odometer reading."""
        state = self._progress
        state.fell_m = at_m
        if state.candidate is not None:
            state.candidate.fall_m = at_m
        elif state.junction is not None and state.junction.fall_m is None:
            state.junction.fall_m = at_m

    def watch(self, label: str) -> None:
        """Let the newest score of a risen one say what it is."""
        state = self._progress
        known = state.candidate or state.junction
        if known is not None and state.high and state.smoothed >= known.probability:
            known.probability, known.label = state.smoothed, label

    def next_junction(self) -> Junction | None:
        """Remove and return the candidate once it is a junction; drop it if it never will be."""
        state, found = self._progress, self._progress.candidate
        if found is None or state.junction is not None:
            return None
        end_m = state.odometer_m if found.fall_m is None else found.fall_m
        lasted = self._is_sure(found, end_m - found.rise_m)
        if found.fall_m is not None and not lasted:
            if state.odometer_m - found.fall_m > self.config.dip_m:
                state.candidate = None
            return None
        if not lasted or self._too_close(found):
            return None
        state.candidate = None
        return found

    def _is_sure(self, found: Junction, high_m: float) -> bool:
        """Return whether a score that was high over a distance is a junction's.

        One that lasts for most of the band need not be as high as one that has just risen.
        """
        long_m = self.config.long_fraction * (self.band.d_far_m - self.band.d_near_m)
        least = self.config.likely if high_m >= long_m else self.config.certain
        return high_m >= self.confirm_m and found.probability >= least

    def forget(self) -> None:
        """Drop what rose during a turn that ends here; a score that is high counts from here on."""
        state = self._progress
        state.candidate = None
        if state.high:
            state.candidate = Junction(rise_m=state.odometer_m, rise_seen=False)

    @property
    def _free_m(self) -> float:
        """Odometer reading from which on a score may be another junction's.

        Behind a turn there is no gap: what was high on the new road did not see the last one.
        """
        state = self._progress
        if state.left_m is None:
            return -math.inf
        return state.left_m + (0.0 if state.left_turned else self.config.gap_m)

    def _dipped(self, known: Junction, at_m: float) -> bool:
        fall_m = known.fall_m
        return fall_m is not None and at_m - fall_m < min(self.config.dip_m, self.band.d_near_m)

    def _too_close(self, found: Junction) -> bool:
        """Return whether the candidate cannot be another junction than the last one, or not yet."""
        if found.fall_m is not None and found.fall_m + self.band.d_near_m < self._free_m:
            self._progress.candidate = None
            return True
        return self._progress.odometer_m < self._free_m
