"""Where a junction's mouth is, by the odometer: from its score's rise and fall, or from sight."""

import math

from juncnet.camera import JunctionBand
from juncnet_services.junction_navigation.progress import Junction, Sighting

SPREAD = 0.15
"""Standard deviation of a distance at which a score rises or falls, as a part of it."""
LONGEST_DELAY = 0.1
SHORTEST_SPAN = 0.45
"""A score that falls after a smaller part of the band was lost, not passed."""
CORRECTION = 0.42
"""Part of the difference between travelled and expected band that is taken for a speed error."""
LARGEST_SCALE = 0.25
MOUTH_BEFORE_M = 2.0
"""A junction's mouth, where its corners begin, lies this much before the edge visibly ends."""
FALLEN_SIGMA_M = 1.0
"""Standard deviation of where a model's score falls, beside that of the camera's geometry."""
SIGHTED_SIGMA_M = 1.2
"""Standard deviation of a mouth known by an opening."""
RISEN = 0.75
"""Smoothed probability from which on a score that was not seen to rise surely has."""
GATE = 2.5
"""Distances that differ by more than this many times their noise are of two places."""


def sighted_mouth_m(sighting: Sighting) -> float:
    """Return the odometer reading of the mouth of the junction that an opening belongs to."""
    return sighting.near_m - MOUTH_BEFORE_M


def mouth_m(junction: Junction, band: JunctionBand, odometer_m: float) -> float:
    """Return the odometer reading at which the junction's mouth is or will be reached.

    What the score says and where openings of the junction were seen, left and right, which a skewed
    road shifts either way, are weighed by their variances. A junction that was counted for its
    opening, before its score rose, is where that is. While the score is high the mouth is no nearer
    than `d_near`.
    """
    scored_m = scored_mouth_m(junction, band, odometer_m)
    if not junction.sightings:
        return scored_m
    sighted_m = _mean_sighted_m(junction)
    if not junction.rise_seen:
        return _outlasted_m(junction, sighted_m, band, odometer_m)
    scored_variance = _scored_sigma_m(junction, band) ** 2
    weight = scored_variance / (scored_variance + SIGHTED_SIGMA_M**2)
    mouth = weight * sighted_m + (1 - weight) * scored_m
    if junction.fall_m is None:
        return max(mouth, min(scored_m, odometer_m + band.d_near_m))
    return mouth


def _mean_sighted_m(junction: Junction) -> float:
    mouths = [sighted_mouth_m(sighting) for sighting in junction.sightings]
    return sum(mouths) / len(mouths)


def _outlasted_m(
    junction: Junction, sighted_m: float, band: JunctionBand, odometer_m: float
) -> float:
    """Return where the mouth is by an opening, unless a score that rose since says: farther away.

    Then the opening was another one, a path's or a drive's, before the junction.
    """
    if junction.probability < RISEN:
        return sighted_m
    if junction.fall_m is None:
        farthest_m = sighted_m + band.d_far_m - band.d_near_m
        return max(sighted_m, min(odometer_m + band.d_near_m, farthest_m))
    fallen_m = junction.fall_m + band.d_near_m
    return fallen_m if fallen_m - sighted_m > GATE * SIGHTED_SIGMA_M else sighted_m


def agree(junction: Junction, sighting: Sighting, band: JunctionBand, odometer_m: float) -> bool:
    """Return whether an opening can be this junction's, as far as its score tells."""
    if not junction.rise_seen:
        return True
    apart_m = sighted_mouth_m(sighting) - scored_mouth_m(junction, band, odometer_m)
    return abs(apart_m) <= GATE * math.hypot(_scored_sigma_m(junction, band), SIGHTED_SIGMA_M)


def scored_mouth_m(junction: Junction, band: JunctionBand, odometer_m: float) -> float:
    """Return where the score says that the mouth is.

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


def _scored_sigma_m(junction: Junction, band: JunctionBand) -> float:
    """Return the standard deviation of where the score says the mouth is: less once it fell."""
    rise_m = SPREAD * band.d_far_m
    if not _plausible_fall(junction, band):
        return rise_m
    return min(rise_m, _fallen_sigma_m(band))


def _fallen_sigma_m(band: JunctionBand) -> float:
    return math.hypot(SPREAD * band.d_near_m, FALLEN_SIGMA_M)


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
    """Return whether the score stayed high for a distance that fits the camera, and an opening."""
    if junction.fall_m is None:
        return False
    if not junction.rise_seen:
        return True
    span_m = band.d_far_m - band.d_near_m
    travelled_m = junction.fall_m - junction.rise_m
    return travelled_m >= SHORTEST_SPAN * span_m and not _denied(junction, junction.fall_m, band)


def _denied(junction: Junction, fall_m: float, band: JunctionBand) -> bool:
    """Return whether the score fell elsewhere than the junction's openings say that its mouth is.

    Of both the rise, which was seen from farther away, is nearer to the openings then.
    """
    if not junction.sightings:
        return False
    sighted_m = _mean_sighted_m(junction)
    risen_m, fallen_m = junction.rise_m + band.d_far_m, fall_m + band.d_near_m
    gate_m = GATE * math.hypot(_fallen_sigma_m(band), SIGHTED_SIGMA_M)
    apart = abs(fallen_m - sighted_m) > gate_m
    return apart and abs(sighted_m - risen_m) < abs(fallen_m - risen_m)
