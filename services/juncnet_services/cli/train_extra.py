"""What commands say that need the extra `[train]` where it is not installed."""

import sys
from collections.abc import Generator
from contextlib import contextmanager

from juncnet.extras import install_command


@contextmanager
def needs_train(command: str) -> Generator[None]:
    """End the program with status 2 and what to install when an import within fails."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("juncnet"):
            raise
        print(f"{command} needs {error.name}: {install_command('train')}", file=sys.stderr)
        raise SystemExit(2) from error
