"""Openings in the road's edge that a follower sees: followed over pictures, told from noise."""

import math

from juncnet.camera import CameraGeometry
from juncnet.messages import Phase, RoadOpening, RoadSeen, RoadSurface
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.arms import leads_on
from juncnet_services.junction_navigation.place import (
    GATE,
    agree,
    mouth_m,
    sighted_mouth_m,
)
from juncnet_services.junction_navigation.progress import Junction, Place, Progress, Sighting

SIGMA = (0.4, 0.1)
"""Noise of a distance: constant, metres, and as a part of it."""
HEAVIEST = 40.0
"""Old pictures count for no more than this together: the odometer drifts."""
SURE_HEIGHTS = 1.5
"""A sure opening was seen while the robot went on by so many camera heights,"""
SURE_FRAMES = 8
"""in so many pictures, and in more than it was missed in,"""
SURE_PROBABILITY = 0.6
"""and with a mean score that speaks for it: a plaza, a drive or a parked car opens an edge too."""
BORNE_OUT_BAND = 0.3
"""One with a lower score is sure, too, where a risen score has lasted for this part of the band,"""
NARROWEST_ROAD_M = 3.5
"""and it is so long: a path's or a drive's is shorter."""
MOVING = 0.5
"""What goes along with the robot by more than this part of its way is no opening: a bend's edge."""
BAY, DEEPEST = 3, 20
"""So many more maps that show no road behind an opening than do: a lay-by. No more are counted."""
SAME_M = 5.0
"""Openings left and right that are no farther apart are of one junction."""
SCORED_BAND = 0.8
"""Part of d_far from which on the score of a junction is surely high."""
FORGET_M = 3.0
ASIDE_RAD = math.radians(3)
"""A robot that looks farther aside than this sees other surface end before it than its road's."""


class Sightings:
    """Keeps the sightings of a `Progress` and of its junction up to date."""

    def __init__(self, camera: CameraGeometry, progress: Progress) -> None:
        self._band, self._progress = camera.band, progress
        self._sure_m = SURE_HEIGHTS * camera.height_m

    def see(
        self,
        road: RoadSeen,
        at_m: float,
        trusted: bool = True,
        aside_rad: float = 0.0,
        surface: RoadSurface | None = None,
    ) -> None:
        """Take what a picture from the odometer reading `at_m` shows of other roads.

        `trusted`: whether the road is surely the robot's own. An edge of one that bends into a side
        arm says nothing against the opening there. `aside_rad`: from the way that the robot holds
        to where it looked. `surface`: a map that says which openings lead nowhere.
        """
        state = self._progress
        if state.phase is Phase.CROSSING and state.junction:
            _see_far_side(state.junction, road, at_m, abs(aside_rad) <= ASIDE_RAD)
        seen = {opening.side: opening for opening in road.openings}
        for sighting in self._all():
            opening = seen.get(sighting.side)
            if opening is not None and _joined(sighting, opening, at_m):
                del seen[sighting.side]
            elif trusted and self._misses(sighting, opening, at_m):
                sighting.missed += 1
        for opening in seen.values():
            if opening.near_m is not None:
                state.sightings.append(_begun(opening, opening.near_m, at_m))
        state.sightings = [s for s in state.sightings if self._worth_keeping(s)]
        if surface is not None:
            for sighting in state.sightings:
                _see_depth(sighting, surface, road, at_m)
        if state.junction is not None and state.leave_m is None:
            self._adopt(state.junction)

    def weigh(self) -> None:
        """Let the newest smoothed score speak for the sightings that it is about."""
        far_m = SCORED_BAND * self._band.d_far_m
        for sighting in self._all():
            ahead_m = sighted_mouth_m(sighting) - self._progress.odometer_m
            if self._band.d_near_m <= ahead_m <= far_m:
                sighting.scored += 1
                difference = self._progress.smoothed - sighting.probability
                sighting.probability += difference / sighting.scored

    def next_junction(self) -> Junction | None:
        """Return a junction whose opening is sure and no part of the last junction; else None."""
        state = self._progress
        if state.junction is not None:
            return None
        left_m = -math.inf if state.left_m is None else state.left_m
        sure = [s for s in state.sightings if self._sure(s) and sighted_mouth_m(s) > left_m]
        if not sure:
            return None
        first = min(sure, key=lambda s: s.near_m)
        found, state.candidate = state.candidate, None
        if found is None:
            found = Junction(
                rise_m=sighted_mouth_m(first) - self._band.d_far_m,
                rise_seen=False,
                fall_m=None if state.high else state.fell_m,
                probability=first.probability,
            )
        found.sightings.append(first)
        state.sightings.remove(first)
        return found

    def forget(self, behind_m: float | None = None) -> None:
        """Drop the sightings up to an odometer reading; None: all, the road is another one."""
        state = self._progress
        state.sightings = [
            s for s in state.sightings if behind_m is not None and sighted_mouth_m(s) > behind_m
        ]

    def _all(self) -> list[Sighting]:
        junction = self._progress.junction
        return [*(junction.sightings if junction else ()), *self._progress.sightings]

    def _misses(self, sighting: Sighting, opening: RoadOpening | None, at_m: float) -> bool:
        """Return whether a picture, whose nearest opening is `opening`, shows an edge instead."""
        if at_m + self._band.d_near_m >= sighting.near_m:
            return False
        if opening is None:
            return True
        return opening.near_m is not None and at_m + opening.near_m > sighting.near_m

    def _sure(self, sighting: Sighting) -> bool:
        return (
            sighting.last_m - sighting.first_m >= self._sure_m
            and sighting.frames >= max(SURE_FRAMES, sighting.missed)
            and sighting.scored >= SURE_FRAMES
            and (sighting.probability >= SURE_PROBABILITY or self._borne_out(sighting))
            and sighting.drift <= MOVING
            and sighting.depth > -BAY
        )

    def _borne_out(self, sighting: Sighting) -> bool:
        """Return whether a score that rose says that a junction is where a road's width opens.

        Neither would be believed alone: the score was never certain, the opening's mean one is low.
        """
        risen, at_m = self._progress.candidate, self._progress.odometer_m
        if risen is None or not risen.rise_seen or sighting.far_m is None:
            return False
        high_m = (at_m if risen.fall_m is None else risen.fall_m) - risen.rise_m
        lasted = high_m >= BORNE_OUT_BAND * (self._band.d_far_m - self._band.d_near_m)
        wide = sighting.far_m - sighting.near_m >= NARROWEST_ROAD_M
        return lasted and wide and agree(risen, sighting, self._band, at_m)

    def _worth_keeping(self, sighting: Sighting) -> bool:
        passed = sighting.near_m < self._progress.odometer_m - FORGET_M
        return not passed and sighting.missed <= sighting.frames + SURE_FRAMES

    def _adopt(self, junction: Junction) -> None:
        """Give the counted junction the openings beside it; take from it those that are not.

        One to turn into is expected, and believed sooner.
        """
        state = self._progress
        at_m, into = state.odometer_m, turning.side(state.turn_here)
        own = [
            s
            for s in junction.sightings
            if s.missed < s.frames and agree(junction, s, self._band, at_m)
        ]
        junction.sightings = own
        expected_m = mouth_m(junction, self._band, at_m)
        for sighting in sorted(state.sightings, key=lambda s: abs(sighted_mouth_m(s) - expected_m)):
            near = not own or abs(sighted_mouth_m(sighting) - sighted_mouth_m(own[0])) <= SAME_M
            seen = sighting.last_m - sighting.first_m >= self._sure_m / 2
            seen = seen or (sighting.side == into and sighting.frames >= SURE_FRAMES)
            fits = junction.rise_seen and agree(junction, sighting, self._band, at_m)
            if near and seen and (own or fits) and all(s.side != sighting.side for s in own):
                own.append(sighting)
                state.sightings.remove(sighting)


def _begun(opening: RoadOpening, near_m: float, at_m: float) -> Sighting:
    sighting = Sighting(
        side=opening.side,
        near_m=at_m + near_m,
        far_m=None if opening.far_m is None else at_m + opening.far_m,
        weight=1 / _sigma_m(near_m) ** 2,
        first_m=at_m,
        last_m=at_m,
    )
    sighting.place(at_m, at_m + near_m)
    return sighting


def _see_depth(sighting: Sighting, surface: RoadSurface, road: RoadSeen, at_m: float) -> None:
    """Let a map say whether a road leads on behind an opening."""
    far_m = None if sighting.far_m is None else max(sighting.far_m - at_m, 0.0)
    near_m = max(sighting.near_m - at_m, 0.0)
    leads = leads_on(surface, road, RoadOpening(side=sighting.side, near_m=near_m, far_m=far_m))
    if leads is not None:
        depth = sighting.depth + (1 if leads else -1)
        sighting.depth = min(max(depth, -DEEPEST), DEEPEST)


def _sigma_m(ahead_m: float) -> float:
    return SIGMA[0] + SIGMA[1] * ahead_m


def _joined(sighting: Sighting, opening: RoadOpening, at_m: float) -> bool:
    """Return whether an opening is the one sighted, and let it speak for its place then."""
    if opening.near_m is None:
        # It begins beside the robot: this is the far end of one that was sighted before.
        beside = sighting.near_m <= at_m + GATE * SIGMA[0] + _nearest_end_m(opening)
        if beside and opening.far_m is not None:
            sighting.far_m = at_m + opening.far_m
        return beside
    sigma_m = _sigma_m(opening.near_m)
    difference_m = at_m + opening.near_m - sighting.near_m
    if abs(difference_m) > GATE * sigma_m:
        return False
    weight = 1 / sigma_m**2
    sighting.weight = min(sighting.weight + weight, HEAVIEST)
    sighting.near_m += weight / sighting.weight * difference_m
    sighting.frames += 1
    sighting.last_m = at_m
    sighting.place(at_m, at_m + opening.near_m)
    if opening.far_m is not None:
        sighting.far_m = at_m + opening.far_m
    return True


def _see_far_side(junction: Junction, road: RoadSeen, at_m: float, ahead: bool) -> None:
    """Let a picture from a junction's surface say where that, and the robot's road, end.

    `ahead`: whether it shows what lies ahead on the robot's way.
    """
    if ahead and road.ends_m is not None:
        _see_place(junction.end, road.ends_m, at_m)
    far_m = [o.far_m for o in road.openings if o.near_m is None and o.far_m is not None]
    if far_m:
        _see_place(junction.far, max(far_m), at_m)


def _see_place(place: Place, ahead_m: float, at_m: float) -> None:
    """Take a picture from `at_m` that shows a place `ahead_m` ahead.

    Pictures that disagree begin anew: what moves along with the robot is no place.
    """
    sigma_m, difference_m = _sigma_m(ahead_m), at_m + ahead_m - place.at_m
    if place.weight == 0 or abs(difference_m) > GATE * sigma_m:
        place.at_m, place.weight = at_m + ahead_m, 0.0
        difference_m = 0.0
    own = 1 / sigma_m**2
    place.weight = min(place.weight + own, HEAVIEST)
    place.at_m += own / place.weight * difference_m


def _nearest_end_m(opening: RoadOpening) -> float:
    return 0.0 if opening.far_m is None else opening.far_m
