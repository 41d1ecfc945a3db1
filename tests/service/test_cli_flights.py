"""Which worlds are flown, and how a report is kept and gone on with."""

import contextlib
import hashlib
import random
from pathlib import Path
from types import SimpleNamespace

import pytest

from juncnet_services.cli import closed_loop, flights
from juncnet_services.cli.demo import Setup
from juncnet_services.cli.flights import (
    Flown,
    Report,
    flown_before,
    main,
    markdown,
    seeds_of,
    seeds_of_commit,
    write_report,
)
from juncnet_services.cli.judge import Judge, Plan, Summary
from juncnet_services.cli.provenance import provenance


def summary(right: bool) -> Summary:
    verdict = "flown_right" if right else "failed"
    empty = Judge(Plan((1, 2), 10.0), "world", "copter").summary()
    reasons = () if right else ("the mission was not finished",)
    return empty.model_copy(
        update={"verdict": verdict, "flown_right": right, "reasons": reasons},
    )


def test_seeds_are_written_as_ranges() -> None:
    assert seeds_of("1-3") == [1, 2, 3]
    assert seeds_of("7, 3-4,4") == [7, 3, 4]


@pytest.mark.parametrize("text", ["", "a", "3-1", "1-", "-1", "1-99999"])
def test_what_are_no_seeds_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="--seeds"):
        seeds_of(text)


def test_seeds_follow_from_a_commit() -> None:
    commit = "0123456789abcdef0123456789abcdef01234567"
    seeds = seeds_of_commit(commit, 50)
    assert len(set(seeds)) == 50
    assert min(seeds) >= 10_000
    assert max(seeds) <= 999_999
    number = int(hashlib.sha256(f"{commit}:0".encode()).hexdigest()[:16], 16)
    assert seeds[0] == 10_000 + number % 990_000
    assert seeds_of_commit(commit, 3) == seeds[:3]
    with pytest.raises(ValueError, match="hash"):
        seeds_of_commit("HEAD", 3)


@pytest.mark.parametrize("right", [True, False])
def test_the_logs_of_a_failed_flight_alone_are_kept(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    right: bool,
) -> None:
    discarded = list[bool]()

    class FakeDemo(contextlib.nullcontext[None]):
        flight = SimpleNamespace(directory=tmp_path)

        def __init__(self, setup: object) -> None:
            del setup
            super().__init__()

        def fly(self, limit_s: object, live: object, verbose: bool) -> Summary:
            del limit_s, live, verbose
            return summary(right)

        def discard(self) -> None:
            discarded.append(True)

    monkeypatch.setattr(flights, "Demo", FakeDemo)
    assert flights.fly("copter", 3, ()).summary.flown_right is right
    assert bool(discarded) is right
    assert (f"logs of seed 3: {tmp_path}" in capsys.readouterr().err) is not right


def test_a_report_is_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, flown = tmp_path / "flights.json", list[int]()

    def fly(vehicle: str, seed: int, settings: object) -> Flown:
        del vehicle, settings
        flown.append(seed)
        return Flown(seed=seed, voids=seed - 1, summary=summary(seed != 2))

    monkeypatch.setattr(flights, "fly", fly)
    assert main(["--seeds", "1", "--out", str(out)]) == 0
    assert main(["--seeds", "1-2", "--out", str(out), "--resume"]) == 1
    assert flown == [1, 2]
    report = Report.model_validate_json(out.read_text())
    assert [f.seed for f in report.flights] == [1, 2]
    assert not report.all_right
    table = out.with_suffix(".md").read_text()
    assert "1 of 2 flown right** (copter; 0 void; void and flown again: 1)" in table
    assert "| 2 | failed, after 1 void |" in table
    assert "the mission was not finished" in table
    assert table in capsys.readouterr().out


class Loop:
    """Stands for a flight in simulated time; that of world 9 goes wrong."""

    def __init__(self, setup: Setup, lateness: random.Random) -> None:
        assert lateness.random() == random.Random(setup.world.seed).random()
        self.trace = SimpleNamespace(
            errors=[] if setup.world.seed != 9 else ["the follower failed"]
        )

    def fly(self) -> Summary:
        return summary(True)


def test_flights_in_simulated_time_have_a_table_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(closed_loop, "ClosedLoop", Loop)
    out = tmp_path / "flights.json"
    assert main(["--seeds", "3", "--simulated", "--out", str(out)]) == 0
    table = out.with_suffix(".md").read_text()
    assert "1 of 1 flown right** (copter; in simulated time)" in table
    assert "p50" not in table
    assert main(["--seeds", "4", "--resume", "--out", str(out)]) == 2
    assert "other options" in capsys.readouterr().err
    assert main(["--seeds", "9", "--simulated", "--resume", "--out", str(out)]) == 1
    assert "seed 9: the follower failed" in capsys.readouterr().err


def test_a_report_with_other_options_is_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "flights.json"
    origin = provenance(["juncnet", "flights"]).model_copy(update={"commit": "1" * 40})
    rover = Report(vehicle="rover", settings=(), provenance=origin, flights=())
    write_report(rover, "", out)
    assert flown_before(out, rover) == ()
    for other in ({"vehicle": "copter"}, {"simulated": True}, {"settings": ("a.b=1",)}):
        with pytest.raises(ValueError, match="other options"):
            flown_before(out, rover.model_copy(update=other))
    changed = origin.model_copy(update={"commit": f"{origin.commit}-changed"})
    assert flown_before(out, rover.model_copy(update={"provenance": changed})) == ()
    newer = origin.model_copy(update={"commit": "0" * 40})
    with pytest.raises(ValueError, match="this is 0000"):
        flown_before(out, rover.model_copy(update={"provenance": newer}))
    assert "0 of 0" in markdown(Report.model_validate_json(out.read_text()))
