"""A terminated command says so, whatever a library made of the signal on its way."""

import os
import signal
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
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


@pytest.mark.parametrize("command", [swallow, replace, pass_on])
def test_a_terminated_command_ends_with_the_signals_status(
    command: Callable[[list[str]], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    ended: list[int] = []
    monkeypatch.setitem(sys.modules, "juncnet_services.cli.stood_in", SimpleNamespace(main=command))
    monkeypatch.setitem(cli.COMMANDS, "stood-in", ("stood_in", "for this test"))
    monkeypatch.setattr(cli, "_received", [])
    monkeypatch.setattr(os, "_exit", ended.append)
    monkeypatch.setattr(sys, "argv", ["juncnet", "stood-in"])
    with handlers():
        cli.main()
    assert ended == [128 + signal.SIGTERM]
