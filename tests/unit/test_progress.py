"""A training shows how far it is: renewed in a terminal, a line for every twentieth elsewhere."""

import sys

import pytest

from juncnet_services.cli.progress import Progress


def test_a_log_gets_a_line_for_every_twentieth(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress("AlexNet")
    for step in range(1, 101):
        progress(step, 100)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 20
    assert all(line.startswith("AlexNet: ") for line in lines)
    assert " 5/100, " in lines[0]
    assert lines[-1].startswith("AlexNet: " + "█" * 24 + " 100/100, 0 s left")


def test_what_goes_on_in_leaps_gets_as_many(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress()
    for done in range(256, 100_000, 256):
        progress(done, 100_001)
    assert len(capsys.readouterr().err.splitlines()) == 19


def test_the_last_point_of_the_curve_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch", reason="torch is not installed: deploy/test --with-train")
    from juncnet.learning.fit import Point

    progress = Progress()
    progress(19, 20, [])
    progress(20, 20, [Point(0, 0.0, 0.5), Point(2560, 0.25, 0.875)])
    assert capsys.readouterr().err.endswith("loss 0.250, balanced accuracy 87.50 %\n")


def test_the_next_training_begins_anew(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, 10.0, 100.0, 101.0])
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    progress = Progress()
    for step, steps in ((1, 2), (2, 2), (1, 3), (2, 3)):
        progress(step, steps)
    lines = capsys.readouterr().err.splitlines()
    assert lines[2].endswith(" 1/3")
    assert lines[3].endswith(" 2/3, 1 s left")


def test_a_terminal_s_line_is_renewed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    progress = Progress()
    for step in range(1, 1001):
        progress(step, 1000)
    shown = capsys.readouterr().err
    assert shown.count("\n") == 1
    assert shown.startswith("\r\x1b[2K")
    assert shown.count("\r") < 30
