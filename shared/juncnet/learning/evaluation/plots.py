"""Matplotlib as figures here use it: no display, small files, plain axes."""

# Matplotlib leaves many of its own members without types.
# pyright: reportUnknownMemberType=false

from collections.abc import Generator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from juncnet.extras import install_command

MAX_BYTES = 200_000
"""Pictures are committed, so they stay small."""


COLOURS = 64
COARSEST_DPI = 40


class PlotError(RuntimeError):
    """Pictures cannot be drawn; the text says what to install."""


@contextmanager
def drawing(path: Path, width: float, height: float, dpi: int = 100) -> Generator[Any]:
    """Give a matplotlib figure (inches) to draw on, then write it to `path` (PNG).

    Raises:
        PlotError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise PlotError(f"pictures need matplotlib: {install_command('train')}") from error
    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    yield figure
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_png(figure, dpi))


def _png(figure: Any, dpi: int) -> bytes:
    """Return the figure as a PNG of `COLOURS` and at most `MAX_BYTES`, coarser if need be."""
    from PIL import Image

    while True:
        drawn, packed = BytesIO(), BytesIO()
        figure.savefig(drawn, format="png", dpi=dpi)
        picture = Image.open(drawn).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
        picture.save(packed, format="png", optimize=True)
        if packed.tell() <= MAX_BYTES or dpi <= COARSEST_DPI:
            return packed.getvalue()
        dpi = int(dpi * 0.85)
