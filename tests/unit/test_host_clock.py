"""What names a host's clock, on systems that tell their boot in different ways."""

import os
from pathlib import Path

import pytest

from juncnet import flight
from juncnet.flight import HostClock


def test_two_clocks_of_one_boot_are_one() -> None:
    assert HostClock().id == HostClock().id


def test_another_boot_is_another_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    boot = tmp_path / "boot_id"
    monkeypatch.setattr(flight, "BOOT", boot)
    boot.write_text("one\n")
    one = HostClock().id
    boot.write_text("two\n")
    assert (one.split("-")[:2], HostClock().id.split("-")[:2]) == (["boot", "one"], ["boot", "two"])


@pytest.fixture
def without_proc(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder on PATH for a `sysctl`, on a system without Linux's files."""
    monkeypatch.setattr(flight, "BOOT", tmp_path / "none")
    monkeypatch.setattr(flight, "TIME_NAMESPACE", tmp_path / "none")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


def fake_sysctl(folder: Path, script: str) -> None:
    path = folder / "sysctl"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


def test_macos_tells_its_boot_by_sysctl(without_proc: Path) -> None:
    fake_sysctl(without_proc, '[ "$*" = "-n kern.bootsessionuuid" ] && echo 5F2C-01')
    assert HostClock().id == "boot-5F2C-01"


def test_a_system_that_does_not_tell_gives_its_host(without_proc: Path) -> None:
    fake_sysctl(without_proc, "exit 1")
    assert HostClock().id == HostClock().id
    assert HostClock().id != "boot-"
