"""A drawing of lines in a terminal: braille characters, eight dots each. Pure."""

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
Points = NDArray[np.float64]


class Canvas:
    """Draws (N, 2) points in metres, x right and y up, into `columns` x `rows` characters."""

    def __init__(self, bounds: tuple[float, float, float, float], columns: int, rows: int):
        """`bounds`: x_min, y_min, x_max, y_max; the scale is the same along both axes."""
        x0, y0, x1, y1 = bounds
        self._scale = min(
            (2 * columns - 1) / max(x1 - x0, 1e-6), (4 * rows - 1) / max(y1 - y0, 1e-6)
        )
        self._origin = (x0, y1)
        self._cells = np.zeros((rows, columns), np.uint8)
        self._styles = np.full((rows, columns), "", dtype=object)

    def draw(self, points: Points, style: str) -> None:
        """Set the dots at `points`; the cells that they lie in take `style`. Outside: ignored."""
        if len(points) == 0:
            return
        column = np.rint((points[:, 0] - self._origin[0]) * self._scale).astype(int)
        row = np.rint((self._origin[1] - points[:, 1]) * self._scale).astype(int)
        rows, columns = self._cells.shape
        inside = (column >= 0) & (column < 2 * columns) & (row >= 0) & (row < 4 * rows)
        for c, r in zip(column[inside], row[inside], strict=True):
            self._cells[r // 4, c // 2] |= _DOTS[r % 4][c % 2]
            self._styles[r // 4, c // 2] = style

    def mark(self, x_m: float, y_m: float, character: str, style: str) -> None:
        """Put one character at a place."""
        column = round((x_m - self._origin[0]) * self._scale) // 2
        row = round((self._origin[1] - y_m) * self._scale) // 4
        rows, columns = self._cells.shape
        if 0 <= column < columns and 0 <= row < rows:
            self._styles[row, column] = f"{style}|{character}"

    def text(self) -> Text:
        """Return the drawing."""
        text = Text()
        for cells, styles in zip(self._cells, self._styles, strict=True):
            for cell, style in zip(cells, styles, strict=True):
                name, _, character = str(style).partition("|")
                text.append(character or (chr(0x2800 + int(cell)) if cell else " "), name or None)
            text.append("\n")
        return text
