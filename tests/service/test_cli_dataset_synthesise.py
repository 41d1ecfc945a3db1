"""`juncnet dataset synthesise`: shards that the reader reads, the same by seed, made once."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from juncnet.learning.datasets import open_dataset
from juncnet.learning.samples import Samples
from juncnet_services.cli.dataset import synthesise as command
from peers import eventually

pytest.importorskip("rich")

ARGUMENTS = ["--pictures", "14", "--streets", "0.5", "--seed", "1900200", "--processes", "1"]


def test_shards_are_read_back_and_not_made_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "d"
    assert command.main([str(folder), *ARGUMENTS]) == 0
    assert "14 pictures in 1 shards" in capsys.readouterr().out
    dataset = open_dataset(folder)
    assert len(dataset) == 14
    assert dataset.classes == ("none", "junction")
    assert set(dataset.site.tolist()) == {"1900200", "-1900200"}
    assert dataset.info.made_by == "juncnet dataset synthesise d " + " ".join(ARGUMENTS)
    masks = dataset.masks()
    assert masks is not None
    assert masks.any()
    written = (folder / "0000.npz").stat().st_mtime_ns
    assert command.main([str(folder), *ARGUMENTS]) == 0
    assert (folder / "0000.npz").stat().st_mtime_ns == written
    capsys.readouterr()
    for other in (["--pictures", "20"], ["--seed", "7"], ["--driven"], ["--noise", "0"]):
        assert command.main([str(folder), *ARGUMENTS, *other]) == 2
        assert "other options: name another folder" in capsys.readouterr().err
    assert open_dataset(folder).info == dataset.info
    (folder / command.OPTIONS).unlink()
    assert command.main([str(folder), *ARGUMENTS]) == 2
    assert "name another folder" in capsys.readouterr().err
    (shard,) = command.shards_of(command.arguments([str(folder), *ARGUMENTS]))
    again = Samples.concatenate([command.make_site(site) for site in shard.sites()])
    np.testing.assert_array_equal(again.gray, dataset.whole_shards())


def test_ranges_and_kinds_reach_the_pictures(tmp_path: Path) -> None:
    words = [str(tmp_path), "--driven", "--height-m", "2,3", "--tilt-deg", "0", "--haze", "0,0.1"]
    (shard,) = command.shards_of(command.arguments([*words, "--pictures", "600"]))
    assert shard.streets == 0
    assert shard.variety.height_m == (2.0, 3.0)
    assert shard.variety.tilt_deg == 0.0
    assert shard.variety.near_junctions == 0.0
    assert shard.variety.haze == (0.0, 0.1)
    several = list(command.shards_of(command.arguments([str(tmp_path), "--pictures", "15000"])))
    assert sum(s.worlds + s.streets for s in several) == 15000
    assert len({s.seed for s in several}) == len({s.path for s in several}) == len(several)


def test_no_two_shards_have_the_same_world(tmp_path: Path) -> None:
    words = [str(tmp_path), "--pictures", "6001", "--streets", "0", "--per-world"]
    assert len(list(command.shards_of(command.arguments([*words, "6"])))) == 2
    with pytest.raises(ValueError, match="give 6 or more"):
        list(command.shards_of(command.arguments([*words, "5"])))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--pictures", "0"], "at least 1"),
        (["--height-m", "5,2"], "--height-m 5,2: give LOW,HIGH"),
        (["--fov-deg", "wide"], "--fov-deg wide: give LOW,HIGH"),
        (["--palette", "purple"], "purple"),
        (["--noise", "-3"], "noise"),
    ],
)
def test_bad_arguments_end_with_2(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main([str(tmp_path / "d"), *words]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "d").exists()


def children(process: int) -> list[Path]:
    names = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return [Path("/proc", name) for name in names]


@pytest.fixture
def interruptible() -> Iterator[None]:
    """What is started in the background ignores interrupts, and so would what it starts."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_end_of_the_command_alone_ends_its_processes(
    how: signal.Signals, tmp_path: Path
) -> None:
    words = [str(tmp_path / "d"), "--pictures", "6000", "--streets", "0", "--per-world", "6"]
    command = [sys.executable, "-m", "juncnet_services.cli", "dataset", "synthesise", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert eventually(lambda: len(children(process.pid)) == 2)
            workers = children(process.pid)
            assert eventually(lambda: all(busy(worker) for worker in workers))
            process.send_signal(how)
            assert eventually(lambda: not any(worker.exists() for worker in workers), 60.0)
            _, said = process.communicate(timeout=10)
        finally:
            process.kill()
    if how is signal.SIGINT:
        assert process.returncode == 130
        assert "interrupted; the same command goes on" in said
    assert not list((tmp_path / "d").glob("*.npz"))


def busy(worker: Path) -> bool:
    """Whether the process has computed for half a second."""
    return int(worker.joinpath("stat").read_text().split()[13]) > 0.5 * os.sysconf("SC_CLK_TCK")
