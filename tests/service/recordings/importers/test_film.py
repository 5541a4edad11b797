"""A film's frames by the container's own times, whatever its rate."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from service.recordings.importers.film import film_of, read_film
from service.recordings.importers.flight import ImportRefusedError
from service.recordings.recording import Recording
from tests.support.films import SIZE, number_of, write_film


def test_frames_of_variable_rate_keep_their_times(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    times_s = write_film(path)
    lens, film, remarks = film_of(path)
    assert film.time_s == pytest.approx(times_s, abs=1e-6)
    assert (lens.width, lens.height) == SIZE and "of variable rate" in remarks.found[0]
    by_number_s = np.arange(len(times_s)) * times_s[-1] / (len(times_s) - 1)
    assert np.abs(film.time_s - by_number_s).max() > 0.5  # what i / fps would have been off by


def test_the_replay_loads_the_frame_that_was_timed(tmp_path: Path) -> None:
    times_s = write_film(tmp_path / "video.mp4")
    film = film_of(tmp_path / "video.mp4")[1]
    (tmp_path / "telemetry.tlog").write_bytes(b"x")
    recording = Recording(tmp_path)
    for number in (0, 7, 25, 59):
        image = recording.load_image(str(number))
        assert image is not None and number_of(image) == number
        assert film.time_s[number] == pytest.approx(times_s[number], abs=1e-6)
    recording.close()


def test_a_film_by_itself_is_tied_to_nothing(tmp_path: Path) -> None:
    write_film(tmp_path / "a.mp4")
    flight = read_film(tmp_path / "a.mp4")
    assert not flight.frames_tied and flight.epoch_s is None


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_a_film_cut_off_is_refused_in_one_line(tmp_path: Path, share: float) -> None:
    write_film(tmp_path / "a.mp4")
    data = (tmp_path / "a.mp4").read_bytes()
    (tmp_path / "a.mp4").write_bytes(data[: int(share * len(data))] or b"\0" * 100)
    with pytest.raises(ImportRefusedError, match=r"a\.mp4: is no film that OpenCV can read"):
        film_of(tmp_path / "a.mp4")


def test_a_film_that_is_cut_but_can_be_read_gives_what_it_has(tmp_path: Path) -> None:
    path = tmp_path / "a.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, SIZE)
    for number in range(40):
        writer.write(np.full((SIZE[1], SIZE[0], 3), number, np.uint8))
    writer.release()
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    assert 10 <= len(film_of(path)[1].time_s) <= 25
