"""What a data set of any kind holds: its rows, and its pictures as far as they can be read."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.learning.datasets import (
    INFO,
    SPLITS,
    TABLE,
    Dataset,
    DatasetInfo,
    Row,
    Split,
    open_dataset,
    read_class_folders,
    read_info,
    read_rows,
)

NO_CLASS = "no-class"
"""Label of pictures of which nobody could say what they show."""


class Contents:
    """A data set with a table, of shards, or of class folders."""

    def __init__(self, directory: Path) -> None:
        """Read what `directory` says, but no picture.

        Raises:
            DatasetError: it is no data set, or a line of its table is wrong.
        """
        self.directory = directory
        self._shards: Dataset | None = None
        self._table = (directory / INFO).exists() and not read_info(directory).shards
        self.info: DatasetInfo
        if self._table:
            self.info = read_info(directory)
            self.rows = read_rows(directory, self.info)
        elif directory.is_dir() and not (directory / INFO).exists():
            self.info, self.rows = read_class_folders(directory)
        else:
            self._shards = open_dataset(directory)
            self.info = self._shards.info
            self.rows = [_row(self._shards, index) for index in range(len(self._shards))]

    @property
    def unlisted(self) -> list[str]:
        """Pictures in the folder that the table does not know."""
        if not self._table:
            return []
        known = {row.path for row in self.rows} | {INFO, TABLE}
        folders = {path.split("/")[0] for path in known if "/" in path}
        files = (p for name in folders for p in (self.directory / name).rglob("*") if p.is_file())
        return sorted({p.relative_to(self.directory).as_posix() for p in files} - known)

    def picture(self, index: int) -> NDArray[np.uint8] | None:
        """Return a picture, (H, W, 3) BGR or (H, W); None: it is missing, or no whole picture."""
        if self._shards is not None:
            return self._shards.picture(index)
        path = self.directory / self.rows[index].path
        try:
            data = np.frombuffer(path.read_bytes(), np.uint8)
        except OSError:
            return None
        # OpenCV fills up what a JPEG that was cut off lacks, and says nothing. Those of class
        # folders come from anywhere, and may end with what is no picture.
        ours = self._table and path.suffix.lower().startswith(".jp")
        whole = not ours or data[-2:].tobytes() == b"\xff\xd9"
        pixels = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) and whole else None
        return None if pixels is None else np.asarray(pixels, np.uint8)

    def luminance(self, index: int) -> NDArray[np.uint8] | None:
        """Return the luminance (H, W) of a picture; None as `picture`."""
        pixels = self.picture(index)
        if pixels is None or pixels.ndim == 2:
            return pixels
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)


def _row(dataset: Dataset, index: int) -> Row:
    label = int(dataset.label[index])
    name = dataset.classes[label] if label >= 0 else NO_CLASS
    known: dict[str, Split] = {str(s): s for s in SPLITS}
    split = known[str(dataset.split[index])]
    clip, site = str(dataset.clip[index]), str(dataset.site[index])
    return Row(f"picture {index}", name, clip, site, split, float(dataset.time_s[index]))
