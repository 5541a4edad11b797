"""Real frames to train on: what is of one event is in one fold."""

import pytest

from real import event_of


@pytest.mark.parametrize(
    ("folder", "stem", "event"),
    [
        ("smoke_hpwren_drawn", "20170708_Whittier_syp-n__ck0k9ghqt7", "20170708"),
        ("smoke_hpwren_drawn", "20170708_Whittier_syp-n-mono__ck0kcy2pmj", "20170708"),
        ("smoke_hpwren_smokeseg", "20180706_West_lp-n-mobo-c__1530902161_+00480", "20180706"),
        ("smoke_hpwren_drawn", "20180706_West_lp-n__ck0k9dzyzi", "20180706"),
        ("negatives_horizon_uav", "a2-converted.mp4-00.04.37.277-00.04.54.650_0", "negatives_horizon_uav/a2"),
        ("smoke_boreal_uav", "evoDJI_0001_frame97", "smoke_boreal_uav/evoDJI_0001"),
        ("smoke_boreal_uav", "20180706", "smoke_boreal_uav/20180706"),
    ],
)
def test_cameras_side_by_side_and_sets_that_overlap_share_an_event(folder: str, stem: str, event: str) -> None:
    assert event_of(folder, stem) == event
