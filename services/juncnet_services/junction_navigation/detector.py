"""From junction probabilities to junctions: smoothing, hysteresis, and which one it is."""

import math

from juncnet.camera import JunctionBand
from juncnet.messages import Thresholds
from juncnet_services.junction_navigation.config import DetectorConfig
from juncnet_services.junction_navigation.progress import Junction, Progress

MAX_STEP_S = 0.5
SPREAD = 0.15
"""Standard deviation of a distance at which a score rises or falls, as a part of it."""
LONGEST_DELAY = 0.1
SHORTEST_SPAN = 0.45
"""A score that falls after a smaller part of the band was lost, not passed."""
CORRECTION = 0.42
"""Part of the difference between travelled and expected band that is taken for a speed error."""
LARGEST_SCALE = 0.25


class JunctionDetector:
    """Keeps `smoothed`, `high`, `candidate` and `junction.fall_m` of a `Progress` up to date."""

    def __init__(self, config: DetectorConfig, band: JunctionBand, progress: Progress) -> None:
        self.config, self.band = config, band
        self._progress = progress
        self._newest_ns: int | None = None
        self.rise_lag_s = config.smoothing_s * math.log(1 / (1 - config.enter))
        """How much later than a step of the score the smoothed score rises."""
        self.fall_lag_s = config.smoothing_s * math.log(1 / config.leave)
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
        if state.high == (state.smoothed > self.threshold):
            return None
        state.high = not state.high
        return state.high

    @property
    def threshold(self) -> float:
        """What the smoothed probability must cross next."""
        return self.config.leave if self._progress.high else self.config.enter

    def risen(self, at_m: float, label: str) -> None:
        """Note that the score rose at an odometer reading."""
        state = self._progress
        for known in (state.candidate, state.junction):
            if known is not None and known.fall_m is not None and self._dipped(known, at_m):
                known.fall_m = None
                return
        if state.candidate is None:
            state.candidate = Junction(rise_m=at_m, label=label)

    def fallen(self, at_m: float) -> None:
        """Note that the score fell at an odometer reading."""
        state = self._progress
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
        sure = found.probability >= self.config.certain
        lasted = sure and end_m - found.rise_m >= self.confirm_m
        if found.fall_m is not None and not lasted:
            if state.odometer_m - found.fall_m > self.config.dip_m:
                state.candidate = None
            return None
        if not lasted or self._too_close(found):
            return None
        state.candidate = None
        return found

    def forget(self) -> None:
        """Drop what rose during a turn; a score that is still high counts from here on."""
        state = self._progress
        state.candidate = None
        if state.high:
            state.candidate = Junction(rise_m=state.odometer_m, rise_seen=False)

    def _dipped(self, known: Junction, at_m: float) -> bool:
        fall_m = known.fall_m
        return fall_m is not None and at_m - fall_m < min(self.config.dip_m, self.band.d_near_m)

    def _too_close(self, found: Junction) -> bool:
        """Return whether the candidate cannot be another junction than the last one, or not yet."""
        state = self._progress
        if state.left_m is None:
            return False
        free_m = state.left_m + self.config.gap_m
        if found.fall_m is not None and found.fall_m + self.band.d_near_m < free_m:
            state.candidate = None
            return True
        return state.odometer_m < free_m


def mouth_m(junction: Junction, band: JunctionBand, odometer_m: float) -> float:
    """Return the odometer reading at which the junction's mouth is or will be reached.

    The mouth is `d_far` ahead where the score rises and `d_near` ahead where it falls. Both are
    weighed by their variance: 15 % of the distance, and 15 % of what was travelled since. While
    the score is high the mouth cannot be nearer than `d_near`, but a score that never falls delays
    it by no more than a tenth of `d_far`.
    """
    rise_m = junction.rise_m + band.d_far_m
    if junction.fall_m is None:
        latest_m = rise_m + LONGEST_DELAY * band.d_far_m
        return min(max(rise_m, odometer_m + band.d_near_m), latest_m)
    if not _plausible_fall(junction, band):
        return rise_m
    scale = odometer_scale(junction, band)
    fall_m = junction.fall_m + band.d_near_m * scale
    if not junction.rise_seen:
        return fall_m
    travelled_m = junction.fall_m - junction.rise_m
    rise_variance = (SPREAD * band.d_far_m) ** 2 + (SPREAD * travelled_m) ** 2
    fall_variance = (SPREAD * band.d_near_m) ** 2
    weight = rise_variance / (rise_variance + fall_variance)
    return weight * fall_m + (1 - weight) * rise_m


def odometer_scale(junction: Junction, band: JunctionBand) -> float:
    """Return how many odometer metres the robot needs for a metre, as far as the junction tells.

    Between rise and fall lie `d_far - d_near` metres. That is known no better than the robot's
    speed (both to 20 %), so about half of a difference is taken for an error of the speed.
    """
    if junction.fall_m is None or not junction.rise_seen or not _plausible_fall(junction, band):
        return 1.0
    ratio = (junction.fall_m - junction.rise_m) / (band.d_far_m - band.d_near_m)
    return min(max(1 + CORRECTION * (ratio - 1), 1 - LARGEST_SCALE), 1 + LARGEST_SCALE)


def _plausible_fall(junction: Junction, band: JunctionBand) -> bool:
    """Return whether the score stayed high for a distance that fits the camera."""
    if junction.fall_m is None:
        return False
    if not junction.rise_seen:
        return True
    span_m = band.d_far_m - band.d_near_m
    return junction.fall_m - junction.rise_m >= SHORTEST_SPAN * span_m
