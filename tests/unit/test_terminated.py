"""How a command ends that is terminated, interrupted, or has no file to work with."""

import errno
import os
import signal
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from juncnet_services.cli import main as cli


@contextmanager
def handlers() -> Generator[None]:
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    for number in before:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def swallow(_: list[str]) -> int:
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    except SystemExit:
        return 2
    return 0


def replace(_: list[str]) -> int:
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    except SystemExit as error:
        raise ImportError("initialization failed") from error
    return 0


def pass_on(_: list[str]) -> int:
    os.kill(os.getpid(), signal.SIGTERM)
    return 0


def stand_in(command: Callable[[list[str]], int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `juncnet stood-in`, which is the command line, be this command."""
    monkeypatch.setitem(sys.modules, "juncnet_services.cli.stood_in", SimpleNamespace(main=command))
    monkeypatch.setitem(cli.COMMANDS, "stood-in", ("stood_in", "for this test"))
    monkeypatch.setattr(cli, "_received", [])
    monkeypatch.setattr(sys, "argv", ["juncnet", "stood-in"])


@pytest.mark.parametrize("command", [swallow, replace, pass_on])
def test_a_terminated_command_ends_with_the_signals_status(
    command: Callable[[list[str]], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    ended: list[int] = []
    stand_in(command, monkeypatch)
    monkeypatch.setattr(os, "_exit", ended.append)
    with handlers():
        cli.main()
    assert ended == [128 + signal.SIGTERM]


def interrupt(_: list[str]) -> int:
    raise KeyboardInterrupt


def lose_a_file(_: list[str]) -> int:
    Path("/nowhere/at-all.json").write_text("")
    return 0


def fill_the_disk(_: list[str]) -> int:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "big.npz")


@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        (interrupt, 130, "juncnet stood-in: interrupted"),
        (lose_a_file, 2, "/nowhere/at-all.json: No such file or directory: is the path right?"),
        (fill_the_disk, 1, "big.npz: No space left on device: make room, or name another place"),
    ],
)
def test_an_interrupt_and_a_file_that_cannot_be_used_are_one_line(
    command: Callable[[list[str]], int],
    code: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    stand_in(command, monkeypatch)
    with handlers(), pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == code
    assert said in capsys.readouterr().err
