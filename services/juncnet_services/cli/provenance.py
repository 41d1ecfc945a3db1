"""Where figures come from: machine, program and command, beside every result that is kept."""

import os
import platform
import shlex
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from pydantic import BaseModel, ConfigDict

GIT = ("git", "-C", str(Path(__file__).parent))
RESULTS = ("json", "md", "png")
CODE = (":(top)", *(f":(top,exclude)models/*.{kind}" for kind in RESULTS))
"""What makes a checkout a changed one: anything but results that were measured in it."""


class Provenance(BaseModel):
    """What somebody needs to judge figures and to measure them again."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cpu: str
    cores: int
    """That this process may use."""
    python: str
    date: str
    """UTC, ISO 8601."""
    command: str
    commit: str
    """Of the checkout; `-changed` behind it: with changes; empty: not run from a checkout."""


def provenance(command: Sequence[str]) -> Provenance:
    """Return where figures come from that `command` measures here and now."""
    return Provenance(
        cpu=_cpu(),
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1,
        python=platform.python_version(),
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        command=shlex.join(command),
        commit=_commit(),
    )


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    for line in info.read_text().splitlines() if info.exists() else ():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _commit() -> str:
    try:
        commit = _git("rev-parse", "HEAD").stdout.strip()
        changed = _git("diff", "--quiet", "HEAD", "--", *CODE).returncode
    except (OSError, subprocess.SubprocessError):
        return ""
    return f"{commit}-changed" if commit and changed else commit


def _git(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([*GIT, *arguments], capture_output=True, text=True, timeout=10)
