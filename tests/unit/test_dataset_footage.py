"""Footage: intervals, near-duplicates, splits, leaks, selection, labels."""

import json
import math
from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import TypeAdapter

from juncnet.frames import Frame, FrameLayout
from juncnet.learning.datasets import Row, Split
from juncnet.learning.footage.intervals import (
    FootageError,
    Interval,
    classes_of,
    interval_at,
    parse_time,
    read_intervals,
    write_intervals,
)
from juncnet.learning.footage.labelling import (
    Action,
    Labels,
    Mark,
    MarkAction,
    OpenAction,
    SeenAction,
    SiteAction,
    UndoAction,
)
from juncnet.learning.footage.leaks import group_leaks, near_duplicate_leaks, twins_across
from juncnet.learning.footage.likeness import Novelty, close_pairs, descriptor, differences
from juncnet.learning.footage.pixels import as_stored, jpeg
from juncnet.learning.footage.selection import fair_shares, thinned
from juncnet.learning.footage.sheets import CELL_H, CELL_W, contact_sheet, evenly
from juncnet.learning.footage.sides import Rules, sides, within
from juncnet.learning.footage.splits import deal_frames, deal_groups, parse_shares
from juncnet.messages import PixelFormat, Stamp


def noise(seed: int, height: int = 90, width: int = 160) -> NDArray[np.uint8]:
    """A picture that looks like no other: blocks of random shades."""
    rng = np.random.default_rng(seed)
    blocks = rng.integers(20, 230, (height // 10, width // 10), dtype=np.uint8)
    return np.kron(blocks, np.ones((10, 10), np.uint8))


def row(label: str, clip: str, site: str, time_s: float = 0.0, split: Split = "") -> Row:
    return Row(f"{clip}-{time_s}.jpg", label, clip, site, split, time_s)


def test_times_are_seconds_or_minutes() -> None:
    assert parse_time("12.5") == 12.5
    assert parse_time(" 1:02.5 ") == 62.5
    assert parse_time("1:00:00") == 3600
    for wrong in ("", "a", "-1", "1:-2", "nan", "inf"):
        with pytest.raises(ValueError, match=r".*"):
            parse_time(wrong)


def test_an_interval_file_is_read_and_written_back() -> None:
    text = (
        "# mine\nclip, from, to, class, site\na.mp4, 0, 1:01.5, none, elm\n\na.mp4,61.5,70,left\n"
    )
    found = read_intervals(text, "labels.csv")
    assert found == [
        Interval("a.mp4", 0, 61.5, "none", "elm"),
        Interval("a.mp4", 61.5, 70, "left"),
    ]
    assert read_intervals(write_intervals(found), "again") == found
    assert interval_at(found, 61.5) == found[1]
    assert interval_at(found, 70.0) is None
    assert classes_of(i.label for i in found) == ("none", "left")


def test_a_clip_that_looks_like_a_comment_is_none() -> None:
    found = [Interval("#1.mp4", 0, 5, "none"), Interval("b.mp4", 0, 5, "left")]
    assert read_intervals(write_intervals(found), "again") == found


@pytest.mark.parametrize("fps", [24, 30, 30000 / 1001, 59.94])
def test_a_marked_frame_is_of_its_own_class_after_rounding(fps: float) -> None:
    times_s = [index / fps for index in range(200)]
    for at in range(1, 199):
        said = [
            Interval("a", 0, times_s[at], "none"),
            Interval("a", times_s[at], times_s[-1], "left"),
        ]
        read = read_intervals(write_intervals(said), "again")
        labels = [i.label if (i := interval_at(read, times_s[k])) else "" for k in (at - 1, at)]
        assert labels == ["none", "left"]
        assert interval_at(read, times_s[-1]) is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "first line must be"),
        ("clip,from,to\na,0,1\n", "no column class"),
        ("clip,from,to,class\na.mp4,3,2,none\n", "line 2.*ends at 2 s"),
        ("clip,from,to,class\n\n#\na.mp4,x,2,none\n", "line 4.*seconds or minutes"),
        ("clip,from,to,class\na.mp4,1,2,\n", "line 2.*under class"),
        ("clip,from,to,class\na.mp4,1,2,../x\n", "use letters"),
        ("clip,from,to,class,split\na.mp4,1,2,none,dev\n", "split 'dev'"),
        ('clip,from,to,class\na.mp4,0,1,none\n"b.mp4,1,2,none\nc,1,2,none\n', "line 3.*closed"),
        ("clip,from,to,class\na,0,5,none\na,4,6,left\n", "none until 5 s and left from 4 s"),
        (
            "clip,from,to,class\na,0,100,none\na,5,10,none\na,20,30,left\n",
            "none until 100 s and left from 20 s",
        ),
    ],
)
def test_a_wrong_interval_file_says_where(text: str, says: str) -> None:
    with pytest.raises(FootageError, match=says):
        read_intervals(text, "labels.csv")


def test_exposure_makes_no_difference_and_another_picture_does() -> None:
    picture = noise(1)
    darker = (picture * 0.5 + 10).astype(np.uint8)
    assert float(differences(descriptor(picture)[None], descriptor(darker))[0]) < 0.02
    other = float(differences(descriptor(picture)[None], descriptor(noise(2)))[0])
    assert other == pytest.approx(math.sqrt(2), abs=0.2)
    flat = np.full((40, 40), 90, np.uint8)
    assert not descriptor(flat).any()


def test_near_duplicates_of_any_kept_frame_are_skipped() -> None:
    novelty = Novelty(0.25)
    first, second = noise(1), noise(2)
    grain = np.random.default_rng(3).normal(0, 3, first.shape)
    again = np.clip(first + grain, 0, 255).astype(np.uint8)
    assert [novelty.keep(descriptor(p)) for p in (first, again, second, first)] == [
        True,
        False,
        True,
        False,
    ]
    assert Novelty(0.0).keep(descriptor(first))


def test_close_pairs_names_the_closest() -> None:
    a = np.stack([descriptor(noise(i)) for i in range(3)])
    b = np.stack([descriptor(noise(i)) for i in (7, 1)])
    ((i, j, apart),) = close_pairs(a, b, 0.25)
    assert (i, j) == (1, 1)
    assert apart == pytest.approx(0, abs=1e-3)
    assert close_pairs(a, b[:0]) == []


def test_sites_are_dealt_whole_and_every_split_gets_every_class() -> None:
    rows = [
        row(label, f"{site}-{k}", f"site{site}", k)
        for site in range(10)
        for label in ("none", "junction")
        for k in range(1, 9)
    ]
    found = sides(rows, Rules(seed=3))
    by_site = {(r.site, split) for r, split in zip(rows, found, strict=True)}
    assert len(by_site) == 10, "a site stands on one side only"
    have = Counter((split, r.label) for r, split in zip(rows, found, strict=True))
    assert have["train", "junction"] == 8 * 7 or have["train", "junction"] == 8 * 6
    assert all(have[split, c] for split in ("validation", "test") for c in ("none", "junction"))
    assert found == sides(rows, Rules(seed=3))


def test_rare_classes_reach_all_splits() -> None:
    groups = {f"g{i}": {"none": 50} for i in range(6)} | {
        f"j{i}": {"junction": 3} for i in range(3)
    }
    split_of = deal_groups(groups, {}, seed=1)
    assert {split_of[f"j{i}"] for i in range(3)} == {"train", "validation", "test"}


def test_named_sites_and_clips_go_where_they_are_asked_for() -> None:
    rows = [row("none", f"s{i}/c{k}.mp4", f"s{i}", k) for i in range(4) for k in range(3)]
    by_site = sides(rows, Rules(test=("s2",), validation=("s3",)))
    assert {s for r, s in zip(rows, by_site, strict=True) if r.site == "s2"} == {"test"}
    by_clip = sides(rows, Rules(split_by="clip", test=("*/c1.mp4",)))
    assert all(s == "test" for r, s in zip(rows, by_clip, strict=True) if "c1" in r.clip)
    with pytest.raises(FootageError, match="site s2 is asked for in"):
        sides(rows, Rules(test=("s2/c1.mp4",), validation=("s2/c2.mp4",)))
    with pytest.raises(FootageError, match="no site or clip is called 'elm'"):
        sides(rows, Rules(test=("elm",)))
    with pytest.raises(
        FootageError, match=r"asked for in (test|validation) and in (test|validation)"
    ):
        sides(rows, Rules(test=("s2",), validation=("s2",)))


def test_too_few_sites_say_what_to_do() -> None:
    rows = [row("none", f"c{i}", "elm", i) for i in range(5)]
    with pytest.raises(FootageError, match="split by clip"):
        sides(rows, Rules())
    assert set(sides(rows, Rules(split_by="clip"))) == {"train", "validation", "test"}


def test_seen_sites_deals_out_frames_class_by_class() -> None:
    labels = ["none"] * 100 + ["junction"] * 20
    found = deal_frames(labels, (0.7, 0.15, 0.15), seed=2)
    have = Counter(zip(labels, found, strict=True))
    assert [have["none", s] for s in ("train", "validation", "test")] == [70, 15, 15]
    assert [have["junction", s] for s in ("train", "validation", "test")] == [14, 3, 3]


def test_shares() -> None:
    assert parse_shares("80,20,0") == (0.8, 0.2, 0.0)
    for wrong in ("80,20", "a,b,c", "0,50,50", "80,-1,21"):
        with pytest.raises(FootageError, match="three numbers"):
            parse_shares(wrong)


def test_leaks_are_found_and_told_from_what_was_asked_for() -> None:
    rows = [
        row("none", "a", "elm", 0, "train"),
        row("none", "b", "elm", 1, "test"),
        row("none", "c", "oak", 2, "train"),
        row("none", "c", "oak", 3, "validation"),
        row("none", "d", "ash", 4, "test"),
    ]
    by_site = group_leaks(rows, "site")
    assert [(x.kind, x.what, x.asked_for) for x in by_site] == [
        ("site", "elm", False),
        ("site", "oak", False),
        ("clip", "c", False),
    ]
    assert [x.asked_for for x in group_leaks(rows, "clip")] == [True, True, False]
    assert all(x.asked_for for x in group_leaks(rows, "frame"))
    pictures = np.stack([descriptor(noise(seed)) for seed in (1, 1, 2, 3, 4)])
    (leak,) = near_duplicate_leaks(rows, pictures, "site")
    assert leak.what == f"{rows[1].path} and {rows[0].path}"
    assert leak.splits == ("train", "test")
    assert not leak.asked_for
    assert twins_across([r.split for r in rows], pictures, 0.25) == {1}


def test_classes_and_clips_share_a_limit_alike() -> None:
    assert fair_shares({"a": 2, "b": 50, "c": 50}, 22) == {"a": 2, "b": 10, "c": 10}
    rows = [row("none", f"c{k % 2}", "s", k) for k in range(100)]
    rows += [row("junction", "c2", "s", k) for k in range(8)]
    kept = thinned(rows, 40)
    assert Counter(rows[i].label for i in kept) == {"none": 32, "junction": 8}
    assert Counter(rows[i].clip for i in kept) == {"c0": 16, "c1": 16, "c2": 8}
    assert kept == sorted(set(kept))
    assert thinned(rows, 500) == list(range(108))
    learnt = within(rows, Rules(test=("c1",)), 20)
    assert Counter(rows[i].clip for i in learnt) == {"c0": 12, "c1": 50, "c2": 8}


def test_a_contact_sheet_shows_every_picture_in_its_shape() -> None:
    wide = np.full((90, 320, 3), 200, np.uint8)
    sheet = contact_sheet("none, train", [wide] * 7, ["a caption that is far too long to fit"] * 7)
    assert sheet.shape[1] == 6 * (CELL_W + 6) + 6
    height = round(90 * CELL_W / 320)
    assert abs(int((sheet == 200).all(axis=2).sum()) - 7 * height * CELL_W) < 7 * CELL_W
    assert height < CELL_H
    assert evenly(100, 3) == [0, 50, 99] or evenly(100, 3) == [0, 49, 99]


@pytest.mark.parametrize("kind", [PixelFormat.I420, PixelFormat.NV12, PixelFormat.GRAY8])
def test_a_stored_frame_has_the_cameras_own_luminance(kind: PixelFormat) -> None:
    import cv2

    layout = FrameLayout.packed(kind, 160, 90)
    pixels = np.full(layout.nbytes, 128, np.uint8)
    luma = cv2.GaussianBlur(noise(4), (0, 0), 4)
    pixels[: 160 * 90] = luma.ravel()
    frame = Frame(Stamp(epoch=0, sequence=0, time_ns=0, clock="c"), layout, pixels)
    data = np.frombuffer(jpeg(as_stored(frame, 360)), np.uint8)
    back = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), int)
    assert back.shape == luma.shape
    assert np.abs(back - luma).mean() < 1.5
    assert as_stored(frame, 45).shape[:2] == (45, 80)


def opened(*names: str) -> list[Action]:
    return [OpenAction(clip=name, duration_s=30.0, site="elm") for name in names]


def mark(at_s: float, label: str, clip: str = "a") -> MarkAction:
    return MarkAction(clip=clip, at_s=at_s, label=label)


def test_a_mark_holds_until_the_next_or_as_far_as_was_watched() -> None:
    labels = Labels([*opened("a"), mark(2, "none"), mark(8, "junction"), mark(10, "")])
    labels.apply(mark(12, "none"))
    labels.apply(SeenAction(clip="a", to_s=20))
    labels.apply(SeenAction(clip="a", to_s=15))
    assert labels.intervals("a") == [
        Interval("a", 2, 8, "none", "elm"),
        Interval("a", 8, 10, "junction", "elm"),
        Interval("a", 12, 20, "none", "elm"),
    ]
    labels.apply(SeenAction(clip="a", to_s=99))
    assert labels.seen_s("a") == 30.0


def test_the_same_class_again_says_nothing_new_and_a_correction_replaces() -> None:
    labels = Labels([*opened("a"), mark(2, "none"), mark(5, "none"), mark(8, "junction")])
    assert labels.marks("a") == (Mark(2, "none"), Mark(8, "junction"))
    labels.apply(mark(8, "none"))
    assert labels.marks("a") == (Mark(2, "none"),)
    labels.apply(mark(1, ""))
    assert labels.marks("a") == (Mark(2, "none"),)


def test_undo_takes_back_marks_and_sites_in_any_clip_but_not_what_was_watched() -> None:
    labels = Labels([*opened("a", "b"), mark(2, "none"), mark(4, "junction", "b")])
    labels.apply(SiteAction(clip="a", site="oak"))
    labels.apply(SeenAction(clip="a", to_s=9))
    assert [labels.apply(UndoAction()) for _ in range(4)] == ["a", "b", "a", ""]
    assert labels.site("a") == "elm"
    assert labels.marks("a") == labels.marks("b") == ()
    assert labels.seen_s("a") == 9


def test_opening_again_keeps_what_was_said_and_unknown_clips_are_refused() -> None:
    labels = Labels([*opened("a"), mark(2, "none"), SiteAction(clip="a", site="oak"), *opened("a")])
    assert labels.marks("a") == (Mark(2, "none"),)
    assert labels.site("a") == "oak"
    with pytest.raises(KeyError):
        labels.apply(mark(2, "none", "z"))
    assert labels.undoable == 2


def test_actions_survive_json() -> None:
    adapter: TypeAdapter[Action] = TypeAdapter(Action)
    for action in (*opened("a"), mark(1.25, ""), UndoAction(), SeenAction(clip="a", to_s=1)):
        assert adapter.validate_json(action.model_dump_json()) == action
    with pytest.raises(ValueError, match="at_s"):
        adapter.validate_json(json.dumps({"kind": "mark", "clip": "a", "at_s": -1}))
