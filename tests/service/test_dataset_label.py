"""The labelling page's server: every key is saved, only its owner is answered."""

import http.client
import json
import shutil
import threading
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from juncnet.learning.footage.intervals import FootageError, read_intervals
from juncnet.learning.footage.labelling import MarkAction, SeenAction, UndoAction
from juncnet_services.cli import dataset
from juncnet_services.cli.dataset import label as dataset_label
from juncnet_services.cli.dataset.journal import Journal
from juncnet_services.cli.dataset.label_server import LabelServer
from videos import write_video


@contextmanager
def serving(video: Path, out: Path) -> Generator[LabelServer]:
    session = dataset_label.session_of([video], "none,junction", out, None)
    server = LabelServer(session)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        session.close()
        thread.join(5)


def test_a_site_pattern_that_is_none_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = write_video(tmp_path / "a.mp4", 2)
    assert dataset.main(["label", str(video), "--site-from", "("]) == 2
    assert "--site-from '(' is no regular expression" in capsys.readouterr().err


def ask(
    server: LabelServer,
    path: str,
    body: str | None = None,
    token: str | None = None,
    host: str = "127.0.0.1",
) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    try:
        mark = "&" if "?" in path else "?"
        address = f"{path}{mark}token={server.token if token is None else token}"
        headers = {"Host": f"{host}:{server.server_port}"}
        connection.request("POST" if body else "GET", address, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def test_the_labelling_page_saves_every_key_and_goes_on_after_a_crash(tmp_path: Path) -> None:
    video, out = write_video(tmp_path / "a.mp4", 50), tmp_path / "labels.csv"
    with serving(video, out) as server:
        assert b"page.js" in ask(server, "/")[1]
        assert ask(server, "/page.js")[0] == 200
        assert len(json.loads(ask(server, "/times?clip=a.mp4")[1])) == 50
        assert ask(server, "/frame?clip=a.mp4&index=3")[1][:2] == b"\xff\xd8"
        for action in (
            MarkAction(clip="a.mp4", at_s=0.0, label="none"),
            MarkAction(clip="a.mp4", at_s=1.0, label="junction"),
            SeenAction(clip="a.mp4", to_s=1.6),
        ):
            status, state = ask(server, "/action", action.model_dump_json())
            assert status == 200
        assert json.loads(state)["clips"][0]["marks"] == [[0.0, "none"], [1.0, "junction"]]
        # What stands on disk now is what a kill -9 leaves.
        left = tmp_path / "left"
        left.mkdir()
        for name in ("labels.csv", "labels.csv.journal"):
            shutil.copy(tmp_path / name, left / name)
    with (left / "labels.csv.journal").open("ab") as journal:
        journal.write(b'{"kind":"mark","clip":"a.m')  # cut off by the crash
    shutil.copy(video, left / "a.mp4")
    found = read_intervals((left / "labels.csv").read_text(), "labels.csv")
    assert [(i.start_s, i.end_s, i.label) for i in found] == [
        (0.0, 1.0, "none"),
        (1.0, 1.6, "junction"),
    ]
    with serving(left / "a.mp4", left / "labels.csv") as server:
        assert server.session.resumed
        status, state = ask(server, "/action", UndoAction().model_dump_json())
        assert json.loads(state)["clips"][0]["marks"] == [[0.0, "none"]]
    (kept,) = read_intervals((left / "labels.csv").read_text(), "labels.csv")
    assert (kept.end_s, kept.label, kept.site) == (1.6, "none", "a")


def test_the_labelling_page_answers_its_owner_only(tmp_path: Path) -> None:
    video, out = write_video(tmp_path / "a.mp4", 10), tmp_path / "labels.csv"
    with serving(video, out) as server:
        assert server.server_address[0] == "127.0.0.1"
        assert ask(server, "/state", token="guess")[0] == 403
        assert ask(server, "/state", host="evil.example")[0] == 403
        action = MarkAction(clip="a.mp4", at_s=0.0, label="none").model_dump_json()
        assert ask(server, "/action", action, token="")[0] == 403
        assert ask(server, "/action", action.replace("none", "tree"))[0] == 400
        assert ask(server, "/action", action.replace("a.mp4", "b.mp4"))[0] == 400
        assert ask(server, "/action", "{}")[0] == 400
        assert ask(server, "/frame?clip=a.mp4&index=99")[0] == 404
        assert ask(server, "/../../etc/passwd")[0] == 404
        assert server.session.state()["clips"][0]["marks"] == []


def test_labels_of_another_hand_and_damaged_journals_are_not_overwritten(tmp_path: Path) -> None:
    out = tmp_path / "labels.csv"
    out.write_text("clip,from,to,class\n")
    with pytest.raises(FootageError, match="not written by this tool"):
        Journal(out)
    (tmp_path / "labels.csv.journal").write_text('{"kind":"?"}\n{"kind":"undo"}\n')
    with pytest.raises(FootageError, match="line 1 is damaged"):
        Journal(out)


def test_wrong_classes_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_video(tmp_path / "a.mp4", 5)
    for classes in ("junction", "none", "none,none", "none,../x"):
        assert dataset.main(["label", str(tmp_path), "--classes", classes]) == 2
    assert "--classes" in capsys.readouterr().err
