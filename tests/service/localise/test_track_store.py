"""The file of kept tracks: whole or set aside, whatever was done to it, and a disk that fails stops nobody."""

import errno
import hashlib
import logging
import os
import threading
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.localise.continuity import Moment, Refusal
from service.localise.track_store import MAX_BYTES, VERSION, Kept, TrackStore, decode, encode
from tests.support.kept_samples import kept
from tests.support.places import HANG_S

KEPT = kept()
DATA = encode(KEPT)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[TrackStore]:
    made = TrackStore(tmp_path, "drone1")
    yield made
    made.close()


def written(store: TrackStore, content: Kept) -> None:
    store.write(content)
    assert store._idle.wait(HANG_S)


def same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    if is_dataclass(one):
        return type(one) is type(other) and all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other)


def signed(content: Any) -> bytes:
    payload = msgspec.msgpack.encode(content)
    return hashlib.sha256(payload).digest() + payload


def as_builtins() -> dict[str, Any]:
    """The content as plain maps and lists, to be altered."""
    found = msgspec.msgpack.decode(DATA[32:])
    assert isinstance(found, dict)
    return found


def test_what_was_written_is_read(store: TrackStore) -> None:
    assert store.read() is None
    written(store, KEPT)
    found = store.read()
    assert isinstance(found, Kept)
    assert all(same(getattr(found, name), getattr(KEPT, name)) for name in Kept.__struct_fields__)
    assert len(found.localizer.tracks) == 1 and found.localizer.tracks[0].life.observations >= 8
    assert (store.written, store.failed) == (1, 0)
    assert [path.name for path in store.path.parent.iterdir()] == ["drone1.tracks"]  # nothing half-written is left


@pytest.mark.parametrize(
    "length", sorted({0, 1, 31, 32, 33, 40, len(DATA) - 1, *range(64, len(DATA), len(DATA) // 60)})
)
def test_cut_at_any_length_it_is_set_aside(store: TrackStore, length: int, caplog: pytest.LogCaptureFixture) -> None:
    store.path.write_bytes(DATA[:length])
    with caplog.at_level(logging.WARNING):
        assert store.read() is Refusal.DAMAGED
    aside = store.path.with_name("drone1.tracks.damaged")
    assert not store.path.exists() and aside.read_bytes() == DATA[:length]
    (record,) = caplog.records
    assert "drone1.tracks.damaged" in record.getMessage() and record.levelno == logging.WARNING
    assert store.read() is None
    written(store, KEPT)
    assert isinstance(store.read(), Kept)


@settings(deadline=None, max_examples=200)
@given(st.integers(0, len(DATA) - 1), st.integers(1, 255))
def test_any_byte_that_flips_is_noticed(place: int, flip: int) -> None:
    data = bytearray(DATA)
    data[place] ^= flip
    assert decode(bytes(data)) is Refusal.DAMAGED


@settings(deadline=None, max_examples=300)
@given(st.binary(max_size=400), st.booleans())
def test_no_bytes_crash(data: bytes, is_signed: bool) -> None:
    found = decode(hashlib.sha256(data).digest() + data if is_signed else data)
    assert found in (Refusal.DAMAGED, Refusal.OTHER_VERSION)


def paths(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, one in items:
        yield from paths(one, (*path, key))


PATHS = [path for path in paths(as_builtins()) if path]
ODD = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**63), 2**64 - 1), st.floats(), st.text(max_size=5), st.binary(max_size=9),
    st.lists(st.integers(-3, 3), max_size=4), st.just({}), st.just(["<f8", [3], b"\0" * 24]),
    st.just(["<f8", [-1, 2], b"\0" * 16]), st.just(["<f8", [2**40], b""]), st.just(["|O", [1], b"\0" * 8]),
)  # fmt: skip


@settings(deadline=None, max_examples=600)
@given(st.sampled_from(PATHS), ODD)
def test_no_content_crashes(path: tuple[Any, ...], odd: Any) -> None:
    """A value of the file is another, of any type, and the checksum is right all the same."""
    content = as_builtins()
    at: Any = content
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = odd
    found = decode(signed(content))
    assert isinstance(found, Kept) or found in (Refusal.DAMAGED, Refusal.OTHER_VERSION)
    if isinstance(found, Kept):  # nothing that is not finite comes through
        for track in found.localizer.tracks:
            assert np.isfinite(track.filter.positions_m).all() and np.isfinite(track.filter.nuisances).all()


@pytest.mark.parametrize(
    "name",
    ["positions_m", "nuisances", "nuisance_covariance", "bias_variance", "widest_variance", "origin_enu_m"],
)
def test_nan_in_a_cloud_is_damage(name: str) -> None:
    content = as_builtins()
    saved = content["localizer"]["tracks"][0]["filter"]
    dtype, shape, data = saved[name]
    array = np.frombuffer(data, dtype).copy()
    array[0] = np.nan
    saved[name] = [dtype, shape, array.tobytes()]
    assert decode(signed(content)) is Refusal.DAMAGED


@pytest.mark.parametrize(
    "changes",
    [
        {"origin": (np.nan, 8.6, 430.0)},
        {"origin": (91.0, 8.6, 430.0)},
        {"camera_enu_m": (0.0, np.inf, 0.0)},
        {"moment": Moment("b", np.nan, 1.0, None)},
        {"moment": Moment("b", 1.0, 1.0, np.inf)},
    ],
)
def test_numbers_that_are_none_are_damage(changes: dict[str, Any]) -> None:
    assert decode(encode(kept(**changes))) is Refusal.DAMAGED


def test_another_version_is_left_alone_until_it_is_written_over(store: TrackStore) -> None:
    data = signed({"version": VERSION + 1, "unheard": "of"})
    store.path.write_bytes(data)
    assert store.read() is Refusal.OTHER_VERSION
    assert store.path.read_bytes() == data
    written(store, KEPT)
    assert isinstance(store.read(), Kept)


def test_what_is_no_file_or_far_too_large_is_set_aside(store: TrackStore) -> None:
    store.path.mkdir()
    assert store.read() is Refusal.DAMAGED
    os.rmdir(store.path.with_name("drone1.tracks.damaged"))
    os.mkfifo(store.path)  # to open it would wait for ever
    assert store.read() is Refusal.DAMAGED
    with store.path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    assert store.read() is Refusal.DAMAGED
    assert not store.path.exists()


def test_a_full_disk_is_counted_told_once_and_over_when_there_is_room(
    store: TrackStore, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def is_full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    written(store, KEPT)
    before = store.path.read_bytes()
    with caplog.at_level(logging.INFO):
        with monkeypatch.context() as full:
            full.setattr("service.common.files.os.fsync", is_full)
            for _ in range(3):
                written(store, kept(vehicle="drone1", settings="other"))
        assert [record.levelno for record in caplog.records] == [logging.WARNING]
        assert "No space left" in caplog.text
        assert store.path.read_bytes() == before  # what was there is whole
        written(store, KEPT)
    assert (store.written, store.failed) == (2, 3)
    assert [record.levelno for record in caplog.records] == [logging.WARNING, logging.INFO]


def test_a_folder_that_cannot_be_made_stops_nobody(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("in the way")
    store = TrackStore(tmp_path / "file" / "state", "drone1")
    assert store.read() is Refusal.UNREADABLE
    for _ in range(3):
        written(store, KEPT)
    assert (store.written, store.failed) == (0, 3)
    assert sum("cannot be kept" in record.getMessage() for record in caplog.records) == 1
    store.close()


def test_a_folder_that_is_not_there_is_made(tmp_path: Path) -> None:
    store = TrackStore(tmp_path / "new" / "state", "drone1")
    assert store.read() is None
    written(store, KEPT)
    assert isinstance(store.read(), Kept)
    store.close()


def test_a_reader_beside_the_writer_never_sees_half_a_file(store: TrackStore) -> None:
    written(store, KEPT)
    seen: list[object] = []
    stop = threading.Event()

    def read() -> None:
        while not stop.is_set():
            seen.append(decode(store.path.read_bytes()))

    reader = threading.Thread(target=read)
    reader.start()
    for _ in range(50):
        written(store, KEPT)
    stop.set()
    reader.join()
    assert len(seen) > 5 and all(isinstance(one, Kept) for one in seen)


def test_close_waits_for_the_last_write(tmp_path: Path) -> None:
    store = TrackStore(tmp_path, "drone1")
    store.write(KEPT)
    store.close()
    assert decode(store.path.read_bytes()) is not Refusal.DAMAGED
    assert not store._thread.is_alive()


def test_a_write_that_hangs_has_failed(store: TrackStore, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that does not answer, until it does."""
    entered, free = threading.Event(), threading.Event()
    synced = os.fsync

    def hangs(number: int) -> None:
        entered.set()
        free.wait(HANG_S)
        synced(number)

    monkeypatch.setattr("service.common.files.os.fsync", hangs)
    store.write(KEPT)
    assert entered.wait(HANG_S)
    assert (store.written, store.failed, store.is_idle) == (0, 0, False)
    with monkeypatch.context() as hurried:
        hurried.setattr("service.localise.track_store.LATE_S", 0.0)
        assert (store.written, store.failed, store.is_idle) == (0, 1, False)
        free.set()
        assert store._idle.wait(HANG_S)
    assert (store.written, store.failed) == (0, 1)  # it is counted once
    written(store, KEPT)
    assert (store.written, store.failed) == (1, 1)
