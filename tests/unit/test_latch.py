"""What a restart must not forget."""

from pathlib import Path

import pytest

from juncnet.clocks import Instant
from juncnet_services.command_output.arbiter import Latched, LatchKind
from juncnet_services.command_output.latch import LAST_ACCEPTED, LATCH, LastAccepted, Latch

STOP = Latched(kind=LatchKind.HOLD, reason="held by anna", since=Instant(7, "boot-a"))


def test_a_stop_is_found_by_the_next_process_and_gone_after_a_resume(tmp_path: Path) -> None:
    latch = Latch(tmp_path)
    assert latch.read() is None
    assert latch.keep(STOP) == ""
    assert Latch(tmp_path).read() == STOP
    assert Latch(tmp_path).keep(None) == ""
    assert Latch(tmp_path).read() is None


@pytest.mark.parametrize("content", [b"", b"{", b'{"kind": "go", "reason": ""}', b"\xff\x00"])
def test_a_malformed_latch_means_stopped(tmp_path: Path, content: bytes) -> None:
    (tmp_path / LATCH).write_bytes(content)
    found = Latch(tmp_path).read()
    assert found is not None
    assert found.kind is LatchKind.HOLD


def test_an_unreadable_latch_means_stopped_and_says_so_when_it_cannot_be_removed(
    tmp_path: Path,
) -> None:
    (tmp_path / LATCH).mkdir()
    latch = Latch(tmp_path)
    found = latch.read()
    assert found is not None
    assert "unreadable" in found.reason
    assert "latch" in latch.keep(None)


def test_a_latch_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    latch = Latch(tmp_path / "missing")
    assert "restart" in latch.keep(STOP)
    (tmp_path / "missing").mkdir()
    assert latch.keep(STOP) == ""


def test_the_last_acceptance_is_recorded_now_and_then(tmp_path: Path) -> None:
    record = LastAccepted(tmp_path)
    assert record.read() is None
    for ns in (1_000_000_000, 1_400_000_000):
        record.keep(Instant(ns, "here"))
    assert LastAccepted(tmp_path).read() == Instant(1_000_000_000, "here")
    record.keep(Instant(1_500_000_000, "here"))
    assert LastAccepted(tmp_path).read() == Instant(1_500_000_000, "here")


def test_a_malformed_record_is_a_time_that_nobody_knows(tmp_path: Path) -> None:
    (tmp_path / LAST_ACCEPTED).write_text("yesterday")
    assert LastAccepted(tmp_path).read() == Instant(0, "unknown")
