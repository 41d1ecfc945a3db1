"""Which code a figure is said to be of."""

import subprocess
from pathlib import Path

import pytest

from juncnet_services.cli import provenance


def git(folder: Path, *arguments: str) -> str:
    identity = ("-c", "user.name=t", "-c", "user.email=t@localhost")
    command = ["git", "-C", str(folder), *identity, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_results_are_no_change_of_the_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "models").mkdir()
    result, code = tmp_path / "models" / "flights.json", tmp_path / "models" / "juncnet.onnx"
    for path in (result, code):
        path.write_text("before")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "--message", "first")
    monkeypatch.setattr(provenance, "GIT", ("git", "-C", str(tmp_path / "models")))
    head = git(tmp_path, "rev-parse", "HEAD")
    assert provenance.provenance(["juncnet"]).commit == head
    result.write_text("after")
    assert provenance.provenance(["juncnet"]).commit == head
    code.write_text("after")
    assert provenance.provenance(["juncnet"]).commit == f"{head}-changed"


def test_outside_of_a_checkout_no_commit_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(provenance, "GIT", ("git", "-C", str(tmp_path)))
    assert provenance.provenance(["juncnet"]).commit == ""
