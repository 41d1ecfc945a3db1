"""What tests with real processes share."""

from collections.abc import Generator
from pathlib import Path

import pytest

from flights import flights_folder


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Generator[Path]:
    """Return a short folder, for the flights of one test only."""
    with flights_folder(monkeypatch) as path:
        yield path
