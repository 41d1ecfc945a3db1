"""What stands on the ground, drawn from back to front."""

from juncnet.simulation.materials import Bytes
from juncnet.simulation.palettes import Light, Palette
from juncnet.simulation.view import View
from juncnet.simulation.world import World


class Scenery:
    """The trees, buildings and cars of a world, ready to draw."""

    def __init__(self, world: World, palette: Palette, light: Light, haze: tuple[int, ...]) -> None:
        self._world = world

    def draw(self, view: View, luma: Bytes, chroma: Bytes) -> None:
        """Draw everything seen from `view` into the planes of a picture."""
