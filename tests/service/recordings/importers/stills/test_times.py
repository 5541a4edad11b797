"""When pictures were taken: zones by EXIF, by the receiver, by the user; parts of seconds; bursts."""

from dataclasses import replace
from datetime import datetime, timezone

import numpy as np
import pytest

from service.recordings.importers.flight import Given, Remarks
from service.recordings.importers.stills.exif import Exif
from service.recordings.importers.stills.times import Times, times_of

NOON_S = datetime(2024, 6, 1, 12, 0, 0, tzinfo=timezone.utc).timestamp()
AT_NOON = Exif(64, 48, local_s=NOON_S)


def timed(*exifs: Exif, utc_offset_s: float | None = None) -> tuple[Times, Remarks]:
    remarks = Remarks()
    names = [f"{number:03d}.jpg" for number in range(len(exifs))]
    return times_of(exifs, names, Given(utc_offset_s=utc_offset_s), remarks), remarks


def test_the_zone_that_exif_names_counts_most() -> None:
    times, remarks = timed(replace(AT_NOON, zone_s=7200.0, gps_s=NOON_S - 3600.0), utc_offset_s=-3600.0)
    assert times.epoch_s == NOON_S - 7200.0 and not remarks.assumed


def test_else_the_users_word_then_the_receivers_time() -> None:
    assert timed(replace(AT_NOON, gps_s=NOON_S - 3600.0), utc_offset_s=7200.0)[0].epoch_s == NOON_S - 7200.0
    times, remarks = timed(*(replace(AT_NOON, gps_s=NOON_S - 19_800.0 + off) for off in (1.0, 2.0, -1.0)))
    assert times.epoch_s == NOON_S - 19_800.0 and "+5.50 h" in remarks.found[0]  # India


def test_a_camera_whose_clock_was_never_set_is_put_right_by_the_receiver() -> None:
    times, remarks = timed(replace(AT_NOON, gps_s=NOON_S + 86_400.0 * 1000 + 123.0))
    assert times.epoch_s == NOON_S + 86_400.0 * 1000 + 123.0 and "receiver" in remarks.assumed[0]


def test_else_it_is_taken_as_utc_and_that_is_said() -> None:
    times, remarks = timed(AT_NOON)
    assert times.epoch_s == NOON_S and "--utc-offset" in remarks.assumed[0]


def test_pictures_are_in_order_of_time_whatever_their_names() -> None:
    times, _ = timed(*(replace(AT_NOON, local_s=NOON_S + t, has_subseconds=True) for t in (5.25, 0.5, 3.0)))
    np.testing.assert_array_equal(times.order, [1, 2, 0])
    np.testing.assert_array_equal(times.time_s, [0.5, 3.0, 5.25])


@pytest.mark.parametrize("count", [2, 3, 10])
def test_a_burst_of_whole_seconds_is_spread_in_the_order_of_names(count: int) -> None:
    times, remarks = timed(*([AT_NOON] * count), replace(AT_NOON, local_s=NOON_S + 1.0))
    np.testing.assert_allclose(times.time_s, [*(np.arange(count) / count), 1.0], atol=0.0005)
    assert (np.diff(times.time_s) > 0).all()
    assert any("whole seconds" in line for line in remarks.assumed)
