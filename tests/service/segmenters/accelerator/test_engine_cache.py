"""TensorRT's engines on disk: whole or not used, of this board or not used, few; what is wrong is one line."""

import os
from pathlib import Path

import pytest

from service.segmenters.accelerator import engine_cache
from service.segmenters.accelerator.engine_cache import MOST_KEPT, EngineCache

PARTS = {"model": "ab", "board": "Jetson Orin NX", "tensorrt": "10.3.0"}


def built(root: Path, parts: dict[str, str] = PARTS, size: int = 1000) -> Path:
    """A folder with an engine in it, sealed."""
    cache = EngineCache(root, parts)
    assert cache.folder is not None, cache.notes
    (cache.folder / "a.engine").write_bytes(os.urandom(size))
    cache.seal()
    cache.close()
    return cache.folder


def reopened(root: Path, parts: dict[str, str] = PARTS) -> EngineCache:
    cache = EngineCache(root, parts)
    cache.close()
    return cache


def test_what_was_built_is_found_again(tmp_path: Path) -> None:
    folder = built(tmp_path / "engines")
    cache = reopened(tmp_path / "engines")
    assert cache.folder == folder and cache.notes == [] and (folder / "a.engine").exists()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda folder: (folder / "a.engine").write_bytes(b"short"), "is cut short or overwritten (5 bytes of 1000)"),
        (lambda folder: (folder / "a.engine").write_bytes(bytes(1000)), "is not the one that was built here"),
        (lambda folder: (folder / "a.engine").unlink(), "is missing"),
        (lambda folder: (folder / "built.json").unlink(), "was never finished"),
        (lambda folder: (folder / "built.json").write_text("{"), "was never finished"),
    ],
)
def test_what_is_spoilt_is_told_by_name_and_built_anew(tmp_path: Path, spoil, words: str) -> None:  # type: ignore[no-untyped-def]
    folder = built(tmp_path / "engines")
    spoil(folder)
    cache = reopened(tmp_path / "engines")
    assert cache.folder == folder and list(folder.iterdir()) == []
    (note,) = cache.notes
    assert words in note and str(folder) in note and note.endswith("it is not used, one is built for this computer")


def test_one_of_another_board_is_told_and_kept_beside(tmp_path: Path) -> None:
    folder = built(tmp_path / "engines")
    cache = reopened(tmp_path / "engines", PARTS | {"board": "Jetson AGX Orin"})
    assert cache.folder not in (None, folder) and (folder / "a.engine").exists()
    (note,) = cache.notes
    assert note.startswith(
        f"the engine in {folder} is of another board Jetson Orin NX, here Jetson AGX Orin: it is not"
    )


def test_an_engine_that_was_built_anew_in_place_is_sealed_anew(tmp_path: Path) -> None:
    built(tmp_path / "engines")
    built(tmp_path / "engines", size=2000)
    assert reopened(tmp_path / "engines").notes == []


def test_few_are_kept_and_the_oldest_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "engines"
    folders = []
    for number in range(MOST_KEPT + 2):
        folders.append(built(root, {"model": str(number)}))
        os.utime(folders[-1], (1000.0 + number, 1000.0 + number))
    assert [folder.exists() for folder in folders] == [False, False, *[True] * MOST_KEPT]
    (root / "left over").mkdir()
    monkeypatch.setattr(engine_cache, "MOST_BYTES", 3500)
    last = built(root, {"model": "last"})
    assert {one for one in root.iterdir() if one.is_dir()} == {last, folders[-1]}


def test_another_process_that_has_them_is_told(tmp_path: Path) -> None:
    first = EngineCache(tmp_path / "engines", PARTS)
    second = reopened(tmp_path / "engines")
    assert second.folder is None and "another process uses" in second.notes[0]
    first.close()
    assert reopened(tmp_path / "engines").folder is not None


def test_where_nothing_can_be_written_it_is_told_by_name(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    cache = reopened(tmp_path / "file" / "engines")
    assert cache.folder is None
    assert cache.notes == [
        f"no engine can be kept in {tmp_path}/file/engines: Not a directory: it is built at each start"
    ]
    cache.seal()


def test_a_disk_that_fills_while_it_is_sealed_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fills(*_: object, **__: object) -> None:
        raise OSError(28, os.strerror(28))

    cache = EngineCache(tmp_path / "engines", PARTS)
    assert cache.folder is not None
    (cache.folder / "a.engine").write_bytes(b"half")
    monkeypatch.setattr(engine_cache, "write_whole", fills)
    cache.seal()
    cache.close()
    assert "No space left" in cache.notes[0]
    assert "was never finished" in reopened(tmp_path / "engines").notes[0]
