"""Marks on a disk that is slow, that fails, whose folder goes and comes back; the last word is kept at the end."""

import errno
import os
import threading
from pathlib import Path

import pytest

from service.common import files
from service.ground.picture.marks import Mark
from service.ground.record import kept_marks
from service.ground.record.kept_marks import KeptMarks
from tests.support.places import HANG_S


def mark(name: str) -> Mark:
    return Mark(vehicle="drone1", target=1, time_s=1.0, name=name)


def test_a_slow_disk_holds_nobody_up_and_gets_the_latest_alone(tmp_path: Path) -> None:
    began, may_end = threading.Event(), threading.Event()
    written: list[bytes] = []

    def slow(path: Path, data: bytes) -> None:
        began.set()
        assert may_end.wait(HANG_S)
        written.append(data)
        files.write_whole(path, data)

    with KeptMarks(tmp_path, slow) as kept:
        kept.write([mark("first")])
        assert began.wait(HANG_S)
        for number in range(300):
            kept.write([mark(f"word {number}")])
        may_end.set()
    assert len(written) == 2 and KeptMarks(tmp_path).read() == [mark("word 299")]


def test_what_cannot_be_kept_is_told_until_it_is_kept_without_another_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_marks, "_LOOK_S", 0.01)
    tries = threading.Semaphore(0)

    def told(path: Path, data: bytes) -> None:
        try:
            files.write_whole(path, data)
        finally:
            tries.release()

    folder, away = tmp_path / "record", tmp_path / "away"
    folder.mkdir()
    with KeptMarks(folder, told) as kept:
        kept.write([mark("Mill")])
        assert tries.acquire(timeout=HANG_S)
        folder.rename(away)  # no word follows
        for _ in range(2):
            assert tries.acquire(timeout=HANG_S)  # the second begins when the first has told its fault
        assert kept.fault == os.strerror(errno.ENOENT) and not folder.exists()
        folder.mkdir()
        for _ in range(100):
            assert tries.acquire(timeout=HANG_S)
            if (folder / "marks.json").exists():
                break
    assert kept.fault == "" and KeptMarks(folder).read() == [mark("Mill")]


def test_marks_that_were_read_are_written_again_where_their_file_went(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_marks, "_LOOK_S", 0.01)
    with KeptMarks(tmp_path) as kept:
        kept.write([mark("Mill")])
    again = KeptMarks(tmp_path)
    assert again.read() == [mark("Mill")]
    (tmp_path / "marks.json").unlink()
    with again:
        pass
    assert KeptMarks(tmp_path).read() == [mark("Mill")]


def test_a_durable_files_name_is_on_the_disk_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    sync, replace = os.fsync, os.replace

    def synced(handle: int) -> None:
        order.append("folder" if os.path.samestat(os.fstat(handle), tmp_path.stat()) else "file")
        sync(handle)

    def replaced(part: Path, path: Path) -> None:
        order.append("rename")
        replace(part, path)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    files.write_whole(tmp_path / "a", b"1", is_durable=True)
    files.write_whole(tmp_path / "b", b"1")
    assert order == ["file", "rename", "folder", "rename"]
