"""No frame is scored by a network that saw its day, its camera or its clip."""

import pytest

from folds import camera_of, event_of, folds, kin, scenes

HOPE = "20180614_Hope_wc-e__ck0a"
HOPE_AGAIN = "20180614_Hope_wc-e-mobo-c__1529001380_+00420"
BESIDE = "20180614_Bridle_hp-n__ck0b"
SAME_CAMERA = "20180704_hp-n__ck0c"
MONO = "20170708_Whittier_syp-n-mono__ck0d"
COLOUR = "20170709_syp-n-mobo-c__ck0e"
CLIP = "a2-converted.mp4-00.04.37.277-00.04.54.650_0"
SAME_CLIP = "a2-converted.mp4-00.04.57.869-00.05.42.169_30"
OTHER_CLIP = "a20-converted.mp4-00.04.57.869-00.05.42.169_30"
SEQUENCE = "20160604_FIRE_rm-n-mobo-c__1465065660_+00060"
BEFORE = "20160604_FIRE_rm-n-mobo-c__1465063200_-02400"
ALL = [HOPE, HOPE_AGAIN, BESIDE, SAME_CAMERA, MONO, COLOUR, CLIP, SAME_CLIP, OTHER_CLIP, SEQUENCE, BEFORE]


@pytest.mark.parametrize(
    ("stem", "event", "camera"),
    [
        (HOPE, "20180614", "wc-e"),
        (HOPE_AGAIN, "20180614", "wc-e"),
        (SAME_CAMERA, "20180704", "hp-n"),
        (MONO, "20170708", "syp-n"),
        (COLOUR, "20170709", "syp-n"),
        (CLIP, "a2", ""),
        ("evo_frame_0007", "evo", ""),
        ("20170708_Whittier_syp-n__ck0k9ghqt7", "20170708", "syp-n"),
        ("20180706_West_lp-n-mobo-c__1530902161_+00480", "20180706", "lp-n"),
        ("20180706_West_lp-n__ck0k9dzyzi", "20180706", "lp-n"),
        ("evoDJI_0001_frame97", "evoDJI_0001", ""),
    ],
)
def test_a_name_tells_the_day_or_clip_and_the_camera(stem: str, event: str, camera: str) -> None:
    assert (event_of(stem), camera_of(stem)) == (event, camera)


def test_a_day_and_a_camera_join_frames_however_many_steps_away() -> None:
    scene = dict(zip(ALL, scenes(ALL), strict=True))
    assert scene[HOPE] == scene[BESIDE] == scene[SAME_CAMERA]  # by the day, then by the camera
    assert scene[MONO] == scene[COLOUR]  # one mast
    assert scene[CLIP] == scene[SAME_CLIP] != scene[OTHER_CLIP]
    assert scene[SEQUENCE] == scene[BEFORE]
    assert len(set(scene.values())) == 5


def test_validation_is_a_fold_of_its_own_and_takes_what_shares_its_camera() -> None:
    has_smoke = [stem not in {CLIP, SAME_CLIP, OTHER_CLIP, BEFORE} for stem in ALL]
    fold = dict(zip(ALL, folds(ALL, has_smoke, ["20180704"], 2), strict=True))
    assert {fold[one] for one in (HOPE, HOPE_AGAIN, BESIDE, SAME_CAMERA)} == {0}
    assert {fold[MONO], fold[SEQUENCE]} == {1, 2}
    assert fold[CLIP] == fold[SAME_CLIP]


def test_frames_without_smoke_are_dealt_to_every_fold() -> None:
    stems = [f"clip{number}_frame_{frame}" for number in range(9) for frame in range(3)]
    fold = folds([*stems, HOPE, MONO], [False] * len(stems) + [True, True], ["20180614"], 2)
    assert [sorted(set(fold[: len(stems)])), fold[-2]] == [[0, 1, 2], 0]
    assert all(len(set(fold[start : start + 3])) == 1 for start in range(0, len(stems), 3))


def test_a_scene_is_never_in_two_folds() -> None:
    scene, fold = scenes(ALL), folds(ALL, [True] * len(ALL), [], 3)
    assert len({*zip(scene, fold, strict=True)}) == len(set(scene))


def test_who_shares_a_day_or_a_camera_with_what_was_seen_is_known() -> None:
    seen = ["20180614_FIRE_hp-n-mobo-c__1", "a2_frame3"]
    stems = ["20180614_FIRE_wc-e-mobo-c__9", "20190716_FIRE_hp-n-mono__2", "20170625_bm-n__x", "a2_frame9", "a3_frame3"]
    assert kin(stems, seen) == [True, True, False, True, False]
