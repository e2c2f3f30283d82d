"""The run folder: what is written is read back, and what is broken is said to be."""

from __future__ import annotations

import errno
import os
import pickle
import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.cli.main import main
from r2bspec.errors import ExitStatus
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.record.files import RecordError, write_atomically
from r2bspec.record.run_folder import Run, RunFolder, open_run
from r2bspec.record.sample_arrays import MONITOR_DTYPE, PLAYBACK_DTYPE
from run_simulation import Played, Simulation, edited_record, objective, renew_digests

SIMULATION = Simulation(
    segments=[Played(10, [0.01, 0.02]), Played(10, [0.01], complete=False)],
    objectives={"fast": objective("latency.p99 < 60 ms", at="10 Hz")},
)


def test_a_run_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    run = SIMULATION.write(tmp_path / "deep" / "run")

    assert run.plan == SIMULATION.plan()
    assert run.record.run_id == "0123456789abcdef"
    assert [segment.complete for segment in run.record.segments] == [True, False]
    first = run.record.segments[0]
    assert run.playback(first).dtype == PLAYBACK_DTYPE
    assert run.playback(first)["due_ns"][1] - run.playback(first)["due_ns"][0] == 10**8
    assert run.monitor(first, "detections").dtype == MONITOR_DTYPE
    assert run.monitor(first, "detections").size == 2
    assert run.resources().size > 0
    assert run.spec_text().startswith("r2bspec: 1")
    assert not [*run.folder.rglob("*.tmp")]


def test_a_file_that_could_not_be_finished_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    write_atomically(path, b"old")

    def fail(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(RecordError, match="No space left") as caught:
        write_atomically(path, b"new")
    assert caught.value.exit_code == ExitStatus.RUN_FAILED
    assert path.read_bytes() == b"old"
    assert [found.name for found in tmp_path.iterdir()] == ["file"]


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    SIMULATION.write(tmp_path)
    with pytest.raises(RecordError, match="not empty"):
        RunFolder.create(tmp_path)


def test_a_place_that_cannot_be_written_is_an_error_with_a_hint(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot be created") as raised:
        RunFolder.create(tmp_path / "file" / "run")
    assert raised.value.hint


@pytest.mark.parametrize("name", ["../escape", "a/b", "", ".", "..", "-x"])
def test_names_stay_inside_the_folder(tmp_path: Path, name: str) -> None:
    folder = RunFolder.create(tmp_path / "run")
    with pytest.raises(RecordError, match="file name"):
        folder.write_rows("playback", np.empty(0, PLAYBACK_DTYPE), name)
    with pytest.raises(RecordError, match="file name"):
        folder.write_rows("monitor", np.empty(0, MONITOR_DTYPE), "iteration-001", name)
    with pytest.raises(RecordError, match="file name"):
        folder.log_path(name)


class TestBrokenFolders:
    """Each is refused with exit status 2 and a hint, never with a traceback."""

    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        return SIMULATION.write(tmp_path / "run").folder

    def refused(self, folder: Path, message: str) -> None:
        with pytest.raises(RecordError, match=message) as raised:
            open_run(folder)
        assert raised.value.exit_code == 2
        assert raised.value.hint

    def test_missing_or_foreign(self, tmp_path: Path) -> None:
        self.refused(tmp_path / "nowhere", "is not a folder")
        self.refused(tmp_path, "is not a run folder")

    @pytest.mark.parametrize(
        ("file", "run", "message"),
        [
            ("suite.json", "a", "is the folder of a suite"),
            ("pairs.json", "head/001", "is the folder of a comparison"),
            ("pairs.json", "base/001", "is the folder of a comparison"),
            ("tuning.json", "trials/race-1", "is the folder of a search"),
            ("notes", "001", "is not a run folder"),
        ],
    )
    def test_of_several_runs(self, tmp_path: Path, file: str, run: str, message: str) -> None:
        folder = tmp_path / "whole"
        SIMULATION.write(folder / run)
        (folder / file).write_text("{}")
        with pytest.raises(RecordError, match=message) as raised:
            open_run(folder)
        assert str(folder / run) in raised.value.hint
        open_run(folder / run)
        assert "killed" not in raised.value.hint

    def test_another_version(self, folder: Path) -> None:
        with edited_record(folder) as record:
            record["r2bspec_record"] = 2
        self.refused(folder, "format version 2")

    def test_a_segment_that_is_listed_twice(self, folder: Path) -> None:
        with edited_record(folder) as record:
            record["segments"] *= 5
        self.refused(folder, "5 times")

    @pytest.mark.parametrize(
        "content", [b"", b"{", b"[]", b"{}", b'{"r2bspec_record": 1}', b"\xff"]
    )
    def test_damaged_record(self, folder: Path, content: bytes) -> None:
        (folder / "record.json").write_bytes(content)
        self.refused(folder, "damaged")

    def test_no_plan_or_another_one(self, folder: Path) -> None:
        text = (folder / "plan.json").read_text().replace("60 ms", "600 ms")
        (folder / "plan.json").write_text(text)
        self.refused(folder, "is not the plan of this run")
        (folder / "plan.json").unlink()
        self.refused(folder, "cannot be read")

    def test_samples(self, folder: Path) -> None:
        segment = open_run(folder).record.segments[0]
        path = folder / "samples" / segment.id / "playback.npy"
        whole = path.read_bytes()

        def rejected() -> None:
            renew_digests(folder)
            with pytest.raises(RecordError, match="damaged"):
                open_run(folder).playback(segment)

        for content in [whole[:-1], whole[:20], b"", whole + b"x", pickle.dumps([1])]:
            path.write_bytes(content)
            rejected()
        np.save(path, np.zeros(3))
        rejected()
        np.save(path, np.array([object()]), allow_pickle=True)
        rejected()
        run = open_run(folder)
        path.unlink()
        with pytest.raises(RecordError, match="missing"):
            run.playback(segment)

    def test_samples_that_the_run_did_not_write(self, folder: Path) -> None:
        """Every file of samples, whatever has become of it, when it is read."""

        def read_all(run: Run) -> None:
            run.resources()
            for segment in run.record.segments:
                run.playback(segment)
                run.monitor(segment, "detections")
                run.work(segment)

        def refused(message: str) -> None:
            with pytest.raises(RecordError, match=message):
                read_all(open_run(folder))

        files = sorted(folder.rglob("*.npy"))
        assert len(files) == len(open_run(folder).record.samples) == 7
        for path in files:
            whole = path.read_bytes()
            for content in (whole[:-1] + b"x", whole[:-8], b"", whole + b"x"):
                path.write_bytes(content)
                refused(f"{path} is damaged: these are not the samples that the run")
            path.unlink()
            refused(f"{path} is missing")
            path.write_bytes(whole)
        first, second = (file for file in files if file.name == "playback.npy")
        first.write_bytes(second.read_bytes())
        refused(f"{first} is damaged")

    def test_a_segment_without_its_samples(self, folder: Path) -> None:
        segment = open_run(folder).record.segments[1].id
        shutil.rmtree(folder / "samples" / segment)
        self.refused(folder, f"the samples of segment '{segment}' are missing")

    @pytest.mark.parametrize("removed", ["segments", "samples"])
    def test_samples_without_their_segment(self, folder: Path, removed: str) -> None:
        with edited_record(folder) as record:
            segment = record["segments"][0]["id"]
            if removed == "segments":
                del record["segments"][0]
            for place in [each for each in record["samples"] if segment in each]:
                if removed == "samples":
                    del record["samples"][place]
        self.refused(folder, f"does not list both segment and samples of '{segment}'")

    def test_no_digest_leads_out_of_the_folder(self, folder: Path) -> None:
        with edited_record(folder) as record:
            record["samples"]["../x.npy"] = ""
        self.refused(folder, "damaged|cannot be part of a file name")

    def test_samples_without_a_record_are_told(
        self, folder: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert open_run(folder).unlisted_segments() == []
        (folder / "samples/another").mkdir()
        main(["judge", str(folder)])
        note = "note: the record does not list the samples of 'another'; they were not judged\n"
        assert capsys.readouterr().err == note

    @pytest.mark.parametrize("removed", ["", "samples/", "resources.npy"])
    def test_a_record_without_digests(self, folder: Path, removed: str) -> None:
        """Who changes samples would remove them."""
        with edited_record(folder) as record:
            for place in [place for place in record["samples"] if place.startswith(removed)]:
                del record["samples"][place]
        with pytest.raises(RecordError, match="does not list both|has no digest of") as raised:
            read_samples(open_run(folder))
        assert raised.value.hint


def test_a_run_that_was_killed_while_its_samples_grew_is_read(tmp_path: Path) -> None:
    run = SIMULATION.write(tmp_path / "run")
    folder = RunFolder(run.folder)
    folder.write_record(msgspec.structs.replace(run.record, status="incomplete"))
    folder.write_rows("resources", run.resources()[:1])
    folder.write_rows("playback", run.playback(run.record.segments[0]), "iteration-009")
    assert open_run(run.folder).resources().size == 1
