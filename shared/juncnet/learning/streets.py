"""Labelled pictures of random streets, for photographs as people take them.

A street with a junction gives *junction* where a person sees it: its surface and the beginning of a
side road take up enough of the picture, after all that stands in front of them.
"""

import math

import numpy as np

from juncnet.learning.samples import LABELS, MASK_SIZE, Samples, small_mask
from juncnet.learning.street_plan import ARM, ROAD, Street, draw_street
from juncnet.learning.street_view import Eye, StreetView, visible_share
from juncnet.shrink import shrink

SIZE = 64
VIEWS = 6
"""Pictures of one street."""
FRAMES = ((160, 120), (144, 144), (192, 108))
"""Sizes that are rendered."""
SEEN_JUNCTION, SEEN_ARM = 0.015, 0.004
"""Least shares of the picture for *junction*."""
UNSEEN = 0.001
"""Largest share of junction and side roads for *none*; between them nobody can say."""


def drawn_eye(street: Street, rng: np.random.Generator) -> Eye:
    """Return a camera in the street: mostly on the road, level, looking along it."""
    width, height = FRAMES[int(rng.integers(len(FRAMES)))]
    if street.mouth_m is None:
        z = float(rng.uniform(0, 30))
    else:
        ahead = float(np.exp(rng.uniform(math.log(1.0), math.log(32.0)))) - 1.5
        z = max(0.0, street.mouth_m - ahead)
    turned = 0.35 if rng.random() < 0.25 else 0.08
    aside = 1.2 if rng.random() < 0.15 else 0.75
    return Eye(
        x_m=float(rng.uniform(-aside, aside)) * street.half_m + 0.5 * street.bend * z * z,
        z_m=z,
        height_m=float(np.exp(rng.uniform(math.log(0.9), math.log(4.0)))),
        yaw_rad=float(rng.normal(0, turned)) + street.bend * z,
        pitch_rad=float(np.clip(rng.normal(0.01, 0.05), -0.12, 0.11)),
        roll_rad=float(rng.normal(0, 0.015)),
        fov_rad=math.radians(rng.uniform(38, 85)) * (1.0 if width > height else 0.85),
        width=width,
        height=height,
    )


def street_samples(seed: int, n: int) -> Samples:
    """Return `n` labelled pictures of streets drawn by `seed`; the site is the seed."""
    rng = np.random.default_rng([abs(seed), 79])
    gray = np.empty((n, SIZE, SIZE), np.uint8)
    masks = np.empty((n, MASK_SIZE, MASK_SIZE), np.uint8)
    label, mouth = np.empty(n, np.uint8), np.full(n, math.inf, np.float32)
    heights = np.empty(n, np.float32)
    view: StreetView | None = None
    for index in range(n):
        if view is None or index % VIEWS == 0:
            view = StreetView(draw_street(rng), rng)
        eye = drawn_eye(view.street, rng)
        picture, mask = view.picture(eye)
        gray[index] = np.rint(shrink(picture, SIZE))
        label[index] = LABELS.index(_label(*visible_share(mask)))
        mask[mask == ARM] = ROAD
        masks[index] = small_mask(mask)
        heights[index] = eye.height_m
        if view.street.mouth_m is not None:
            mouth[index] = view.street.mouth_m - eye.z_m
    target = np.array([0.0, 1.0, np.nan], np.float32)[label]
    return Samples(gray, target, label, mouth, heights, np.full(n, seed, np.int64), masks)


def _label(junction: float, arm: float) -> str:
    if junction >= SEEN_JUNCTION and arm >= SEEN_ARM:
        return "junction"
    return "none" if junction + arm < UNSEEN else "transition"
