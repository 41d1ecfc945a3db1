"""What to type for a missing package: a command that installs this project's extra, no other's."""

import shlex
import sys
from pathlib import Path

import pytest

from juncnet import extras
from juncnet.extras import install_command


def test_an_extra_comes_from_the_checkout_with_its_constraints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkout = tmp_path / "a checkout"
    constraints = checkout / "deploy" / "constraints.txt"
    constraints.parent.mkdir(parents=True)
    constraints.touch()
    monkeypatch.setattr(extras, "CHECKOUT", checkout)
    words = shlex.split(install_command("train"))
    assert words[:4] == [sys.executable, "-m", "pip", "install"]
    assert words[4:] == ["-c", str(constraints), "-e", f"{checkout}[train]"]


def test_without_a_checkout_it_is_said_where_to_type_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extras, "CHECKOUT", tmp_path)
    command = install_command("train")
    assert command.endswith("(in a checkout)")
    assert "juncnet[train]" not in command
