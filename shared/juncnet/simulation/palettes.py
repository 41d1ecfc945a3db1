"""Colours and light of a world: named palettes, times of day, and their random variation.

Colours are blue, green, red, 0..255, as under a white noon sun; light multiplies them.
`withheld` is the style that nobody tunes or trains on.
"""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juncnet.simulation.world import Surface, TimeOfDay

Colour = tuple[float, float, float]
"""Blue, green, red, 0..255."""


@dataclass(frozen=True)
class Palette:
    """The colours of one kind of country."""

    grass: Colour
    grass_other: Colour
    """What the grass varies towards over some metres."""
    soil: Colour
    """Bare patches between the grass, and mud."""
    asphalt: Colour
    concrete: Colour
    cobble: Colour
    gravel: Colour
    dirt: Colour
    pavement: Colour
    kerb: Colour
    paint: Colour
    """Road markings."""
    leaf: Colour
    leaf_other: Colour
    trunk: Colour
    litter: Colour
    """Fallen leaves, straw or needles beside the road."""
    bareness: float
    """0..1: how much of the ground between the roads is bare soil."""
    litter_density: float
    """Fallen leaves per square metre near roads, 0..2."""
    conifers: float
    """0..1: share of trees that are conifers."""
    contrast: float = 1.0
    """Scale of the ground's fine texture."""

    def surface(self, surface: Surface) -> Colour:
        """Return the colour of a road's surface."""
        colours: dict[Surface, Colour] = {
            "asphalt": self.asphalt,
            "concrete": self.concrete,
            "cobble": self.cobble,
            "gravel": self.gravel,
            "dirt": self.dirt,
        }
        return colours[surface]


@dataclass(frozen=True)
class Light:
    """The light of a time of day."""

    gain: Colour
    """Factor on blue, green, red."""
    zenith: Colour
    """Sky at 40 degrees of elevation, as seen."""
    horizon: Colour
    """Sky at the horizon, and the haze, as seen."""
    clouds: float
    """0..1: share of the sky under clouds."""
    cloud: Colour
    shading: float
    """0..1: how much darker than the sunny side a wall or crown is that faces away from the sun."""


_TEMPERATE = Palette(
    grass=(40, 92, 72),
    grass_other=(50, 112, 104),
    soil=(78, 106, 128),
    asphalt=(142, 140, 138),
    concrete=(160, 168, 172),
    cobble=(138, 142, 148),
    gravel=(152, 166, 174),
    dirt=(112, 148, 176),
    pavement=(140, 146, 150),
    kerb=(178, 184, 186),
    paint=(222, 228, 230),
    leaf=(34, 82, 58),
    leaf_other=(48, 112, 96),
    trunk=(44, 58, 72),
    litter=(60, 96, 118),
    bareness=0.12,
    litter_density=0.15,
    conifers=0.15,
)

PALETTES: dict[str, Palette] = {
    "temperate": _TEMPERATE,
    "dry": replace(
        _TEMPERATE,
        grass=(70, 120, 138),
        grass_other=(62, 108, 112),
        soil=(92, 128, 156),
        cobble=(82, 86, 92),
        asphalt=(82, 84, 86),
        gravel=(172, 192, 206),
        dirt=(132, 168, 200),
        leaf=(58, 92, 86),
        leaf_other=(70, 112, 116),
        litter=(100, 150, 176),
        bareness=0.45,
        litter_density=0.1,
        conifers=0.05,
    ),
    "autumn": replace(
        _TEMPERATE,
        grass=(44, 98, 96),
        grass_other=(52, 112, 136),
        soil=(58, 84, 112),
        cobble=(66, 70, 76),
        asphalt=(62, 60, 60),
        dirt=(104, 136, 160),
        leaf=(30, 92, 168),
        leaf_other=(32, 124, 196),
        litter=(36, 110, 180),
        bareness=0.2,
        litter_density=1.6,
        conifers=0.1,
    ),
    "nordic": replace(
        _TEMPERATE,
        grass=(66, 102, 88),
        grass_other=(84, 122, 124),
        soil=(92, 106, 116),
        cobble=(150, 154, 160),
        asphalt=(152, 146, 140),
        gravel=(168, 172, 176),
        dirt=(138, 154, 166),
        leaf=(44, 70, 46),
        leaf_other=(52, 84, 62),
        litter=(58, 82, 100),
        bareness=0.25,
        litter_density=0.3,
        conifers=0.85,
    ),
    "suburb": replace(
        _TEMPERATE,
        grass=(52, 112, 84),
        grass_other=(62, 130, 108),
        cobble=(62, 66, 70),
        asphalt=(66, 64, 64),
        pavement=(156, 162, 168),
        leaf=(40, 96, 62),
        leaf_other=(56, 128, 98),
        bareness=0.04,
        litter_density=0.2,
        conifers=0.2,
    ),
    "withheld": replace(
        _TEMPERATE,
        grass=(112, 118, 138),
        grass_other=(96, 138, 150),
        soil=(94, 112, 160),
        asphalt=(78, 70, 64),
        concrete=(140, 150, 168),
        cobble=(98, 104, 128),
        gravel=(150, 168, 192),
        dirt=(64, 78, 118),
        pavement=(124, 136, 160),
        kerb=(150, 164, 188),
        paint=(170, 216, 232),
        leaf=(84, 104, 92),
        leaf_other=(92, 128, 140),
        litter=(92, 84, 150),
        bareness=0.5,
        litter_density=0.5,
        conifers=0.4,
        contrast=1.25,
    ),
}

LIGHTS: dict[TimeOfDay, Light] = {
    "morning": Light(
        gain=(0.86, 0.94, 1.0),
        zenith=(214, 168, 128),
        horizon=(214, 222, 228),
        clouds=0.3,
        cloud=(236, 238, 244),
        shading=0.45,
    ),
    "noon": Light(
        gain=(1.04, 1.06, 1.06),
        zenith=(216, 158, 98),
        horizon=(232, 218, 200),
        clouds=0.35,
        cloud=(250, 248, 246),
        shading=0.4,
    ),
    "evening": Light(
        gain=(0.66, 0.76, 0.88),
        zenith=(162, 122, 108),
        horizon=(128, 172, 226),
        clouds=0.45,
        cloud=(150, 164, 212),
        shading=0.55,
    ),
    "overcast": Light(
        gain=(0.86, 0.84, 0.80),
        zenith=(188, 182, 174),
        horizon=(206, 204, 200),
        clouds=0.95,
        cloud=(196, 194, 190),
        shading=0.2,
    ),
}


def palette_named(name: str) -> Palette:
    """Return the palette of that name.

    Raises:
        ValueError: no such palette.
    """
    if name not in PALETTES:
        raise ValueError(f"Style.palette: {name!r} is none of {', '.join(PALETTES)}")
    return PALETTES[name]


def jitter(palette: Palette, rng: np.random.Generator, amount: float) -> Palette:
    """Return the palette with every value varied at random.

    Args:
        palette: What to vary.
        rng: Source of chance; the same state gives the same palette.
        amount: 0: as it is; 1: colours by up to about 30 % in brightness and 15 % in hue.
    """
    common = 1 + 0.12 * amount * rng.uniform(-1, 1)
    values: dict[str, float | Colour] = {}
    for item in fields(palette):
        value: float | Colour = getattr(palette, item.name)
        if isinstance(value, tuple):
            bright = common * (1 + 0.18 * amount * rng.uniform(-1, 1))
            tint = 1 + 0.15 * amount * rng.uniform(-1, 1, 3)
            blue, green, red = (
                float(np.clip(c * bright * t, 4, 250)) for c, t in zip(value, tint, strict=True)
            )
            values[item.name] = (blue, green, red)
        else:
            values[item.name] = float(value * (1 + 0.8 * amount * rng.uniform(-1, 1)))
    values["bareness"] = float(
        np.clip(palette.bareness + 0.3 * amount * rng.uniform(-1, 1), 0, 0.8)
    )
    values["conifers"] = float(np.clip(palette.conifers + 0.5 * amount * rng.uniform(-1, 1), 0, 1))
    return Palette(**values)  # pyright: ignore[reportArgumentType] (fields are tuple or float)


def lit(colour: Colour, light: Light, factor: float = 1.0) -> Colour:
    """Return a colour as it is seen under `light`, times `factor`, within 0..255."""
    b, g, r = (
        min(max(c * g_ * factor, 0.0), 255.0) for c, g_ in zip(colour, light.gain, strict=True)
    )
    return (b, g, r)


def yuv(colour: Colour) -> tuple[int, int, int]:
    """Return Y, U, V of a colour as seen: BT.601, studio range, as OpenCV's I420."""
    b, g, r = colour
    return (
        round(16 + 0.257 * r + 0.504 * g + 0.098 * b),
        round(128 - 0.148 * r - 0.291 * g + 0.439 * b),
        round(128 + 0.439 * r - 0.368 * g - 0.071 * b),
    )


def yuv_planes(picture: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return float32 Y, U, V planes of a (..., 3) blue, green, red picture in 0..255."""
    b, g, r = picture[..., 0], picture[..., 1], picture[..., 2]
    return (
        16 + 0.257 * r + 0.504 * g + 0.098 * b,
        128 - 0.148 * r - 0.291 * g + 0.439 * b,
        128 + 0.439 * r - 0.368 * g - 0.071 * b,
    )
