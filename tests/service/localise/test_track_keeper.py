"""Which targets come back: those of this flight, lately, near by, whatever each clock says."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.localizer import Localizer, LocalizerConfig
from distloc.types import CameraPose, TargetEstimate, TargetState
from service.common.messages import Frame
from service.config.load import check
from service.config.sections import CameraConfig, Config, ConfigError, LocaliserSection, StateConfig
from service.localise.continuity import Moment, Refusal, elapsed_s, host_boot_id, refusal
from service.localise.stage import LocaliseStage
from service.localise.track_keeper import NoKeeper, TrackKeeper, open_keeper
from service.localise.track_store import Kept, TrackStore, decode, encode
from tests.service.autopilot.test_autopilot import MS, OFFSET_NS, Vehicle
from tests.support.cube_samples import CAMERA, cube_mask, empty_mask, pose_at

UTC_OF_BOOT_S = 1_780_000_000.0
FRAMES = 34  # a second and 10 m apart; the target is confirmed at about the 30th
CONFIG = Config(
    camera=CameraConfig(width=1920, height=1080, fx=1200.0, fy=1200.0, cx=959.5, cy=539.5),
    localizer=LocaliserSection(n_particles=2000, max_targets=8),
)


def autopilot_at(
    boot_ms: int, offset_ns: int = OFFSET_NS, utc_of_boot_s: float | None = UTC_OF_BOOT_S, lat: float = 40.0
) -> Vehicle:
    """An autopilot that was heard until `boot_ms`; the host's clock is `offset_ns` ahead of its."""
    vehicle = Vehicle()
    vehicle.offset_ns = offset_ns
    vehicle.heartbeat(boot_ms - 2000)
    vehicle.gps(boot_ms - 1900)
    vehicle.fly(boot_ms - 1000, count=21, lat=lat)
    if utc_of_boot_s is not None:
        say_utc(vehicle, boot_ms, utc_of_boot_s)
    return vehicle


def say_utc(vehicle: Vehicle, boot_ms: int, utc_of_boot_s: float = UTC_OF_BOOT_S) -> None:
    vehicle.send(mavlink.MAVLink_system_time_message(round((utc_of_boot_s + boot_ms * 1e-3) * 1e6), boot_ms), boot_ms)


def frame_pose(vehicle: Vehicle, boot_ms: int, east_m: float) -> CameraPose:
    return replace(pose_at(east_m), stamp_s=(boot_ms * MS + vehicle.offset_ns) * 1e-9)


def localizer(config: Config = CONFIG, seed: int = 0) -> Localizer:
    settings = LocalizerConfig(n_particles=config.localizer.n_particles, max_targets=config.localizer.max_targets)
    return Localizer(CAMERA, settings, rng=np.random.default_rng(seed))


def keeper_of(folder: Path, vehicle: Vehicle, boot_id: str = "boot-1", config: Config = CONFIG) -> TrackKeeper:
    return TrackKeeper(config, vehicle.autopilot, TrackStore(folder, "drone1"), 600.0, boot_id)


def first_run(folder: Path, boot_ms: int = 100_000, utc_of_boot_s: float | None = UTC_OF_BOOT_S) -> TargetEstimate:
    """A flight of 34 s past the cube, from 40 N 3 E, kept; then the process ends."""
    vehicle = autopilot_at(boot_ms, utc_of_boot_s=utc_of_boot_s)
    keeper, located, estimates = keeper_of(folder, vehicle), localizer(), []
    for k in range(FRAMES):
        pose = frame_pose(vehicle, boot_ms + 1000 * k, 10.0 * k)
        assert keeper.take_up(located, pose)
        estimates = located.step(pose, cube_mask(pose))
        keeper.keep(located, pose, bool(estimates))
        assert keeper._store._idle.wait(20.0)
    keeper.close()
    (one,) = estimates
    assert one.state is TargetState.CONFIRMED
    return one


@pytest.mark.parametrize("lat", [40.0, 40.002])
def test_after_a_crash_the_target_is_where_it_was_on_the_map(tmp_path: Path, lat: float) -> None:
    was = first_run(tmp_path)
    old = autopilot_at(100_000).autopilot.frame_enu
    vehicle = autopilot_at(135_000, lat=lat)  # another first position, so other axes
    new = vehicle.autopilot.frame_enu
    assert old is not None and new is not None
    keeper, located = keeper_of(tmp_path, vehicle), localizer(seed=1)
    pose = frame_pose(vehicle, 135_000, 300.0)
    assert keeper.take_up(located, pose)
    assert keeper.counters() == {"kept": "on", "written": 0, "failed": 0, "restored": 1, "refused": None}
    # looks away, so that nothing is learnt
    (now,) = located.step(replace(pose, R_cam_from_enu=pose.R_cam_from_enu * [[-1.0], [1.0], [-1.0]]), empty_mask())
    assert (now.id, now.state, now.observations) == (was.id, TargetState.COASTING, was.observations)
    assert (now.first_seen_s, now.last_seen_s) == (was.first_seen_s, was.last_seen_s)  # the host's clock went on
    lat_lon, where = old.geodetic_from_enu(was.position_enu_m), new.geodetic_from_enu(now.position_enu_m)
    apart_m = old.enu_from_geodetic(*where) - old.enu_from_geodetic(*lat_lon)
    assert float(np.linalg.norm(apart_m)) < 0.1 * was.ellipse95.semi_major_m
    assert now.ellipse95.semi_major_m == pytest.approx(was.ellipse95.semi_major_m, rel=0.15)
    keeper.close()


REFUSED: dict[str, tuple[dict[str, Any], dict[str, Any], Refusal]] = {
    "11 minutes later": ({"boot_ms": 790_000}, {}, Refusal.STALE),
    "the autopilot was switched on again": (
        {"boot_ms": 20_000, "offset_ns": OFFSET_NS + 115_000 * MS},
        {},
        Refusal.OTHER_FLIGHT,
    ),
    "in another place": ({"boot_ms": 135_000, "lat": 40.1}, {}, Refusal.OUT_OF_REACH),
    "another camera": (
        {"boot_ms": 135_000},
        {"config": Config(camera=CameraConfig(fx=1300.0, fy=1300.0, cx=960.0, cy=540.0), localizer=CONFIG.localizer)},
        Refusal.OTHER_SETTINGS,
    ),
    "another vehicle": (
        {"boot_ms": 135_000},
        {"config": Config(vehicle="drone2", camera=CONFIG.camera, localizer=CONFIG.localizer)},
        Refusal.OTHER_VEHICLE,
    ),
    "the host's clock of before the crash": ({"boot_ms": 100_000}, {}, Refusal.FUTURE),
    "the next day, the host and the autopilot switched on again": (
        {"boot_ms": 135_000, "utc_of_boot_s": UTC_OF_BOOT_S + 86_400.0},
        {"boot_id": "boot-2"},
        Refusal.STALE,
    ),
    "a battery later, minutes by GPS": (
        {"boot_ms": 60_000, "utc_of_boot_s": UTC_OF_BOOT_S + 200.0},
        {"boot_id": "boot-2"},
        Refusal.OTHER_FLIGHT,
    ),
    "GPS says that it is yesterday": (
        {"boot_ms": 135_000, "utc_of_boot_s": UTC_OF_BOOT_S - 86_400.0},
        {"boot_id": "boot-2"},
        Refusal.FUTURE,
    ),
}


@pytest.mark.parametrize(("flown", "kept_by", "reason"), REFUSED.values(), ids=REFUSED.keys())
def test_what_does_not_hold_any_more_stays_in_the_file(
    tmp_path: Path, flown: dict[str, Any], kept_by: dict[str, Any], reason: Refusal
) -> None:
    first_run(tmp_path)
    vehicle = autopilot_at(**flown)
    keeper, located = keeper_of(tmp_path, vehicle, **kept_by), localizer()
    pose = frame_pose(vehicle, flown["boot_ms"], 300.0)
    if reason in (Refusal.OTHER_FLIGHT, Refusal.OUT_OF_REACH):
        assert not keeper.take_up(located, pose)
        pose = frame_pose(vehicle, flown["boot_ms"] + 3000, 300.0)
    assert keeper.take_up(located, pose)
    assert (keeper.counters()["restored"], keeper.counters()["refused"]) == (0, str(reason))
    assert located.step(pose, empty_mask()) == []
    assert located.snapshot().next_id == 1
    keeper.close()


def test_one_odd_first_pose_does_not_cost_the_targets(tmp_path: Path) -> None:
    first_run(tmp_path)
    vehicle = autopilot_at(135_000)
    keeper, located = keeper_of(tmp_path, vehicle), localizer()
    assert not keeper.take_up(located, frame_pose(vehicle, 135_000, 50_000.0))
    assert keeper.counters()["refused"] is None
    assert keeper.take_up(located, frame_pose(vehicle, 135_500, 300.0))
    assert (keeper.counters()["restored"], keeper.counters()["refused"]) == (1, None)
    keeper.close()


def test_after_the_hosts_reboot_gps_tells_the_time(tmp_path: Path) -> None:
    was = first_run(tmp_path)
    # the host woke up 40 s after the last frame; its clock began anew, the autopilot's went on
    offset_ns = -160_000 * MS
    vehicle = autopilot_at(169_000, offset_ns, utc_of_boot_s=None)
    keeper, located = keeper_of(tmp_path, vehicle, "boot-2"), localizer()
    assert not keeper.take_up(located, frame_pose(vehicle, 169_000, 300.0))
    assert not keeper.take_up(located, frame_pose(vehicle, 170_000, 300.0))
    say_utc(vehicle, 170_500)
    pose = frame_pose(vehicle, 171_000, 300.0)
    assert keeper.take_up(located, pose)
    (now,) = located.step(replace(pose, R_cam_from_enu=pose.R_cam_from_enu * [[-1.0], [1.0], [-1.0]]), empty_mask())
    assert (now.id, now.state) == (was.id, TargetState.COASTING)
    assert pose.stamp_s - now.last_seen_s == pytest.approx(171.0 - (100.0 + FRAMES - 1), abs=0.01)
    keeper.close()


def test_after_the_hosts_reboot_without_gps_time_it_waits_three_seconds_and_starts_empty(tmp_path: Path) -> None:
    first_run(tmp_path)
    vehicle = autopilot_at(169_000, -160_000 * MS, utc_of_boot_s=None)
    keeper, located = keeper_of(tmp_path, vehicle, "boot-2"), localizer()
    answers = [keeper.take_up(located, frame_pose(vehicle, 169_000 + 500 * k, 300.0)) for k in range(8)]
    assert answers == [False] * 6 + [True] * 2
    assert keeper.counters()["refused"] == "no_clock"
    keeper.close()


def test_a_damaged_file_means_an_empty_start_and_the_next_one_is_whole(tmp_path: Path) -> None:
    first_run(tmp_path)
    path = tmp_path / "drone1.tracks"
    path.write_bytes(path.read_bytes()[:-7])
    vehicle = autopilot_at(135_000)
    keeper, located = keeper_of(tmp_path, vehicle), localizer()
    assert keeper.counters()["refused"] == "damaged"
    assert (tmp_path / "drone1.tracks.damaged").exists()
    for k in range(8):
        pose = frame_pose(vehicle, 135_000 + 1000 * k, 10.0 * k)
        assert keeper.take_up(located, pose)
        keeper.keep(located, pose, bool(located.step(pose, cube_mask(pose))))
    keeper.close()
    assert isinstance(decode(path.read_bytes()), Kept)


def test_it_writes_at_most_once_a_second_and_only_what_changed(tmp_path: Path) -> None:
    vehicle = autopilot_at(100_000)
    keeper, located = keeper_of(tmp_path, vehicle), localizer()
    for k in range(50):  # ten frames a second, 1 m apart: five steps of 10 m
        pose = frame_pose(vehicle, 100_000 + 100 * k, 1.0 * k)
        keeper.keep(located, pose, is_changed=k < 25)
        assert keeper._store._idle.wait(20.0)
    assert keeper.counters()["written"] == 4  # at 0, 1 and 2 s, and at 3 s what changed after that
    vehicle_back = frame_pose(vehicle, 100_000, 1.0)  # a clock that went back does not stop it
    keeper.keep(located, vehicle_back, is_changed=True)
    assert keeper._store._idle.wait(20.0)
    assert keeper.counters()["written"] == 5
    keeper.close()


def test_fewer_places_than_targets_is_another_setting(tmp_path: Path) -> None:
    """A file whose fingerprint fits though its content does not."""
    first_run(tmp_path)
    path = tmp_path / "drone1.tracks"
    kept = decode(path.read_bytes())
    assert isinstance(kept, Kept)
    (track,) = kept.localizer.tracks
    many = tuple(replace(track, life=replace(track.life, id=number)) for number in range(1, 10))
    content = {name: getattr(kept, name) for name in Kept.__struct_fields__}
    path.write_bytes(encode(Kept(**(content | {"localizer": replace(kept.localizer, tracks=many, next_id=10)}))))
    vehicle = autopilot_at(135_000)
    keeper, located = keeper_of(tmp_path, vehicle), localizer()
    assert keeper.take_up(located, frame_pose(vehicle, 135_000, 300.0))
    assert keeper.counters()["refused"] == "other_settings"
    keeper.close()


class Seer:
    """A segmenter that sees the cube."""

    name = "cube"

    def segment(self, frame: Frame, pose: CameraPose) -> np.ndarray:
        return cube_mask(pose)


def test_the_stage_starts_nothing_before_it_is_known_what_there_was(tmp_path: Path) -> None:
    was = first_run(tmp_path)
    vehicle = autopilot_at(169_000, -160_000 * MS, utc_of_boot_s=None)
    keeper = keeper_of(tmp_path, vehicle, "boot-2")
    stage = LocaliseStage(CONFIG, Seer(), vehicle.autopilot, keeper=keeper)  # type: ignore[arg-type]
    seen = []
    for k in range(6):
        if k == 4:
            say_utc(vehicle, 170_900)
        pose = frame_pose(vehicle, 169_000 + 500 * k, 690.0 + 5.0 * k)
        seen.append(stage.process(Frame(round(pose.stamp_s * 1e9), "", None), pose))
    assert [len(one.estimates) for one in seen[:4]] == [0, 0, 0, 0]
    assert all(one.mask is not None for one in seen)
    (now,) = seen[4].estimates
    assert (now.id, now.state, now.observations) == (was.id, TargetState.CONFIRMED, was.observations + 1)
    keeper.close()


def test_a_heading_that_jumped_before_the_targets_came_back_turns_them_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are from before the jump, though they are taken up after it."""
    first_run(tmp_path)
    jump_rad, biases_rad = 0.2, []
    for turned_rad in (0.0, jump_rad):
        vehicle = autopilot_at(135_000)
        monkeypatch.setattr(vehicle.autopilot, "heading_turned_rad", lambda stamp_ns, turned_rad=turned_rad: turned_rad)
        keeper = TrackKeeper(CONFIG, vehicle.autopilot, TrackStore(tmp_path, "drone1"), 600.0, "boot-1")
        stage = LocaliseStage(CONFIG, Seer(), vehicle.autopilot, seed=0, keeper=keeper)  # type: ignore[arg-type]
        pose = frame_pose(vehicle, 135_000, 300.0)
        away = replace(pose, R_cam_from_enu=pose.R_cam_from_enu * [[-1.0], [1.0], [-1.0]])
        monkeypatch.setattr(Seer, "segment", lambda self, frame, pose: empty_mask())
        stage.process(Frame(round(pose.stamp_s * 1e9), "", None), away)
        keeper.close()
        (track,) = stage.localizer._tracker._tracks  # type: ignore[union-attr]
        biases_rad.append(track.filter.cloud.bias_rad)
    assert biases_rad[1] - biases_rad[0] == pytest.approx([0.0, 0.0, -jump_rad], abs=1e-3)


A, B = Moment("a", 100.0, 50.0, 1e9), Moment("a", 160.0, 110.0, None)


def test_elapsed_by_the_host_else_by_gps_else_unknown() -> None:
    assert elapsed_s(A, B) == 60.0
    assert elapsed_s(A, Moment("b", 7.0, 110.0, 1e9 + 61.0)) == 61.0
    assert elapsed_s(A, Moment("b", 160.0, 110.0, None)) is None
    assert elapsed_s(Moment("", 1.0, 1.0, None), Moment("", 2.0, 2.0, None)) is None


@pytest.mark.parametrize(
    ("now", "moved_m", "expected"),
    [
        (B, 6499.0, None),
        (B, 6501.0, Refusal.OUT_OF_REACH),
        (B, float("nan"), Refusal.OUT_OF_REACH),
        (Moment("a", 699.0, 649.0, None), 0.0, None),
        (Moment("a", 701.0, 651.0, None), 0.0, Refusal.STALE),
        (Moment("a", float("nan"), 651.0, None), 0.0, Refusal.FUTURE),
        (Moment("a", 99.5, 49.5, None), 0.0, None),
        (Moment("a", 98.0, 48.0, None), 0.0, Refusal.FUTURE),
        (Moment("a", 160.0, 104.0, None), 0.0, Refusal.OTHER_FLIGHT),
        (Moment("a", 160.0, 116.0, None), 0.0, Refusal.OTHER_FLIGHT),
        (Moment("a", 160.0, float("nan"), None), 0.0, Refusal.OTHER_FLIGHT),
        (Moment("b", 160.0, 110.0, None), 0.0, Refusal.NO_CLOCK),
    ],
)
def test_rules(now: Moment, moved_m: float, expected: Refusal | None) -> None:
    assert refusal(A, now, 600.0, moved_m) is expected


def test_the_hosts_boot_has_a_name() -> None:
    assert len(host_boot_id()) == 36
    assert host_boot_id() == host_boot_id()


def test_where_it_keeps(tmp_path: Path) -> None:
    pilot = autopilot_at(100_000).autopilot

    def opened(state: StateConfig, environment: dict[str, str], **more: Any) -> object:
        keeper = open_keeper(Config(state=state, **more), pilot, environment)
        keeper.close()
        return keeper._store.path.parent if isinstance(keeper, TrackKeeper) else None

    systemd = {"STATE_DIRECTORY": f"{tmp_path}/systemd:/elsewhere"}
    assert opened(StateConfig(), {}) is None
    assert opened(StateConfig(), systemd) == tmp_path / "systemd"
    assert opened(StateConfig(dir=str(tmp_path / "mine")), systemd) == tmp_path / "mine"
    assert opened(StateConfig(dir=""), systemd) is None
    assert opened(StateConfig(), systemd, localizer=LocaliserSection(filter="bootstrap")) is None
    assert NoKeeper().counters() == {"kept": "off"}


def test_a_file_in_place_of_the_folder_is_a_bad_config(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match=r"state\.dir is '.*file': it must be a folder"):
        check(Config(state=StateConfig(dir=str(tmp_path / "file"))))
