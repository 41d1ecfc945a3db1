"""Contact sheets: many small pictures on one, with a word under each."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

CELL_W, CELL_H = 192, 108
CAPTION_H = 16
HEADER_H = 34
GAP = 6
BACKGROUND = 28
TEXT = (225, 225, 225)
FAINT = (150, 150, 150)

Bytes = NDArray[np.uint8]


def evenly(count: int, limit: int) -> list[int]:
    """Return at most `limit` indices of 0 .. `count` - 1, evenly spread, both ends included."""
    if count <= limit:
        return list(range(count))
    return np.linspace(0, count - 1, limit).round().astype(int).tolist()


def contact_sheet(
    title: str, pictures: Sequence[Bytes], captions: Sequence[str], columns: int = 6
) -> Bytes:
    """Return one picture, (H, W, 3) uint8 BGR, of `pictures`, BGR or (H, W), of any size, in rows.

    Each is scaled to fit its cell, its shape kept. Captions that are too wide lose their beginning.
    """
    columns = min(columns, max(len(pictures), 1))
    rows = -(-len(pictures) // columns)
    width = GAP + columns * (CELL_W + GAP)
    height = HEADER_H + rows * (CELL_H + CAPTION_H + GAP)
    sheet = np.full((height, width, 3), BACKGROUND, np.uint8)
    _write(sheet, title, (GAP, 22), 0.5, TEXT)
    for index, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        left = GAP + index % columns * (CELL_W + GAP)
        top = HEADER_H + index // columns * (CELL_H + CAPTION_H + GAP)
        cell = fitted(picture)
        y, x = (CELL_H - cell.shape[0]) // 2 + top, (CELL_W - cell.shape[1]) // 2 + left
        sheet[y : y + cell.shape[0], x : x + cell.shape[1]] = cell
        _write(sheet, _tail(caption), (left, top + CELL_H + 12), 0.36, FAINT)
    return sheet


def fitted(picture: Bytes) -> Bytes:
    """Return a picture, BGR or (H, W), as BGR scaled to fit a cell, its shape kept."""
    if picture.ndim == 2:
        picture = np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), np.uint8)
    height, width = picture.shape[:2]
    scale = min(CELL_W / width, CELL_H / height)
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(picture, size, interpolation=how), np.uint8)


def _tail(caption: str) -> str:
    shown = caption.encode("ascii", "replace").decode()
    while shown and cv2.getTextSize(shown, cv2.FONT_HERSHEY_SIMPLEX, 0.36, 1)[0][0] > CELL_W:
        shown = shown[1:]
    return shown


def _write(
    sheet: Bytes, text: str, at: tuple[int, int], scale: float, colour: tuple[int, int, int]
) -> None:
    plain = text.encode("ascii", "replace").decode()
    cv2.putText(sheet, plain, at, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA)
