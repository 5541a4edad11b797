"""The mount's angles from a recorded flight that sees a known landmark, with how late the stamps are, or by scenery."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from distloc.calibration.mount_calibration import (
    MOUNT_SIGMA_RAD,
    LandmarkSight,
    MountCalibration,
    calibrate_mount,
    nearest_sights,
    shifted,
    wrapped_rad,
)
from distloc.calibration.pose_trail import PoseTrail
from distloc.calibration.scenery_mount import SceneryMount
from distloc.calibration.time_offset import (
    LEAST_USED,
    MOST_OFFSET_S,
    TimeOffset,
    aim_residuals,
    estimate_time_offset,
    turn_residuals,
    vee,
)
from distloc.geometry.rotations import R_FRD_FROM_CAM
from distloc.types import FloatArray
from service.commands.calibrate.landmark_flight import GATE_RAD, LandmarkFlight
from service.commands.calibrate.scenery_flight import SceneryFlight
from service.config.load import load_config
from service.config.sections import CameraConfig, Config
from service.recordings.recording import Recording, RecordingError

Kind = Literal["onnx", "classical", "sobel", "recorded"]
_FINE_GATE_RAD = float(np.radians(4.0))  # about where a first estimate puts it: what a compass adds in between
_ROUNDS = 3
_UNKNOWN_TIME_S = 0.05  # a camera whose latency nobody measured
_LATE_S = 0.01
_FOCAL_SURE = 3.0  # standard deviations for a focal length to be another
_UNSEEN_SHARE = 0.5  # of the prior's sigma: what is left of it says that the flight did not tell


def run_calibrate(
    recording: Recording,
    config_path: Path | None,
    landmark: tuple[float, float, float] | None,
    segmenter: Kind | None,
    wants_time_offset: bool,
    echo: Callable[[str], None],
    on_progress: Callable[[int], None] = lambda stamp_ns: None,
) -> None:
    """Print TOML ready to paste, with what is no setting in comments; RecordingError where the flight cannot tell."""
    path = config_path or recording.config_path
    config = load_config(path) if path else Config()
    if segmenter:
        config = msgspec.structs.replace(config, segmenter=msgspec.structs.replace(config.segmenter, kind=segmenter))
    if landmark is None:
        for line in _by_scenery(recording, config, on_progress):
            echo(line)
        return
    flight = LandmarkFlight(recording, config, landmark)
    flight.read(on_progress)
    sights, found, offset, how = _estimated(flight, config.camera.mount.R_body_from_mount)
    for line in [*_seen_lines(flight, sights, found), "", *_mount_lines(config.camera, found)]:
        echo(line)
    if wants_time_offset:
        for line in ["", *_offset_lines(config.camera, offset, how)]:
            echo(line)
    elif offset.offset_s is not None and abs(offset.offset_s) > max(_LATE_S, 2.0 * offset.sigma_s):
        echo(f"# taken into account: frames are stamped {offset.offset_s * 1e3:+.0f} ms late; see --time-offset")


def _by_scenery(recording: Recording, config: Config, on_progress: Callable[[int], None]) -> list[str]:
    """The mount, and the focal length where it plainly is another, by the scenery alone."""
    flight = SceneryFlight(recording, config)
    flight.read(on_progress)
    found, state, camera = flight.mount(), flight.sights, config.camera
    turned_deg = min(float(np.degrees(found.turned_rad)), 360.0)
    lines = [
        f"# by the scenery in {len(state)} keyframes of {flight.with_pose} frames with a pose, over "
        f"{turned_deg:.0f} deg of heading: on one heading a compass that is off looks like the mount's yaw",
        "",
        *_mount_lines(camera, found),
    ]
    focal, sigma = flight.focal
    lines += ["", f"# the focal length is {focal:+.2%} of what the config says, sigma {sigma:.2%}"]
    if abs(focal) > _FOCAL_SURE * sigma:
        given = camera.camera()
        lines += ["[camera]", *(f"{name} = {getattr(given, name) * (1.0 + focal):.1f}" for name in ("fx", "fy"))]
    return lines


def _estimated(
    flight: LandmarkFlight, R_old: FloatArray
) -> tuple[list[LandmarkSight], MountCalibration, TimeOffset, str]:
    """The mount with the poses of when the frames were really taken, for while the drone rocks a late stamp looks like
    a turned mount. The sigmas hold what the time's own error does.
    """
    sights, found = _mount(flight, flight.candidates, R_old)
    if len(flight.trail) < 2:
        return sights, found, TimeOffset(None, np.inf, 0), "trail of poses"
    trail = PoseTrail(flight.trail)
    offset, how = _time_offset(flight, trail, sights, found, R_old)
    offset_s = offset.offset_s or 0.0
    sigma_s = _UNKNOWN_TIME_S if offset.offset_s is None else offset.sigma_s
    sights, found = _mount(flight, shifted(flight.candidates, trail, offset_s, R_old), R_old)
    later = _mount(flight, shifted(flight.candidates, trail, offset_s + sigma_s, R_old), R_old)[1]
    change_rad = wrapped_rad(later.angles_rad - found.angles_rad)
    covariance_rad2 = found.covariance_rad2 + np.outer(change_rad, change_rad)
    return sights, dataclasses.replace(found, covariance_rad2=covariance_rad2), offset, how


def _mount(
    flight: LandmarkFlight, candidates: Sequence[Sequence[LandmarkSight]], R_old: FloatArray
) -> tuple[list[LandmarkSight], MountCalibration]:
    """The landmark's sights and the mount, by turns: which segment it is becomes clear once the mount is known."""
    landmark_enu_m = flight.landmark_enu_m
    R_base_from_old, gate_rad = np.eye(3), GATE_RAD
    for _ in range(_ROUNDS):
        sights = nearest_sights(candidates, landmark_enu_m, R_base_from_old, gate_rad)
        try:
            found = calibrate_mount(sights, landmark_enu_m, R_old)
        except ValueError as error:
            raise RecordingError(
                f"{flight.folder}: the landmark was in view in {flight.in_view} of {flight.with_pose} frames, with a "
                f"segment near it in {len(candidates)}: {error}"
            ) from error
        R_base_from_old, gate_rad = found.R_base_from_mount @ R_old.T, _FINE_GATE_RAD
    return sights, found


def _time_offset(
    flight: LandmarkFlight, trail: PoseTrail, sights: list[LandmarkSight], found: MountCalibration, R_old: FloatArray
) -> tuple[TimeOffset, str]:
    """By the landmark's motion in the frames, where that does not tell by the frames' own; and which of them.

    The landmark's place is known; what else moves in a frame, also moves by the flight over unknown ground.
    """
    # what the camera sees, in the axes of a camera in the old mount, as the trail's are
    K = R_FRD_FROM_CAM.T @ R_old.T @ found.R_base_from_mount @ R_FRD_FROM_CAM
    used = [one for one, is_used in zip(sights, found.used, strict=True) if is_used]
    stamps_s = np.array([one.sight.stamp_s for one in used])
    rays = np.stack([R_FRD_FROM_CAM.T @ R_old.T @ one.R_enu_from_base.T @ one.sight.axes[2] for one in used]) @ K.T
    by_landmark = estimate_time_offset(aim_residuals(trail, stamps_s, rays, flight.landmark_enu_m), stamps_s)
    if by_landmark.offset_s is not None or len(flight.turns) < LEAST_USED:
        return by_landmark, "motion of the landmark's segment"
    starts_s, ends_s = (np.array([turn[i] for turn in flight.turns]) for i in (0, 1))
    turns_rad = vee(np.stack([turn[2] for turn in flight.turns])) @ K.T
    return estimate_time_offset(turn_residuals(trail, starts_s, ends_s, turns_rad), ends_s), "motion of the frames"


def _seen_lines(flight: LandmarkFlight, sights: list[LandmarkSight], found: MountCalibration) -> list[str]:
    rms_deg = np.degrees(np.sqrt(np.mean(found.residuals_rad[found.used] ** 2, axis=0)))
    R = np.stack([one.R_enu_from_base for one in sights])
    headings_rad = np.unwrap(np.arctan2(R[:, 0, 0], R[:, 1, 0]))
    turned_deg = min(float(np.degrees(np.ptp(headings_rad))), 360.0)
    tilted_deg = float(np.degrees(np.std(np.arcsin(R[:, 2, :2]), axis=0).max()))
    return [
        f"# landmark in view in {flight.in_view} of {flight.with_pose} frames with a pose, a segment near it in "
        f"{len(flight.candidates)}: {found.used.sum()} used, {len(sights) - found.used.sum()} rejected as outliers",
        f"# left of the sights: {rms_deg[0]:.2f} deg across, {rms_deg[1]:.2f} deg up; their white errors are "
        + (f"{found.white_scale:.1f} times those of the config" if found.white_scale > 1.0 else "as the config says"),
        f"# seen over {turned_deg:.0f} deg of heading while rocking by {tilted_deg:.1f} deg rms: "
        "the more of both, the surer",
    ]


def _mount_lines(camera: CameraConfig, found: MountCalibration | SceneryMount) -> list[str]:
    old_deg = np.array([camera.mount.yaw_deg, camera.mount.pitch_deg, camera.mount.roll_deg])
    change_deg = np.degrees(wrapped_rad(found.angles_rad - np.radians(old_deg)))
    out = ["[camera.mount]"]
    for name, old, change, sigma_rad in zip(
        ("yaw", "pitch", "roll"), old_deg, change_deg, found.sigmas_rad, strict=True
    ):
        unseen = "; this flight hardly tells" if sigma_rad > _UNSEEN_SHARE * MOUNT_SIGMA_RAD else ""
        new = f"{name}_deg = {_one_turn(old + change):.2f}"
        out.append(f"{new:<20}# was {old:g}: {change:+.2f}, sigma {np.degrees(sigma_rad):.2f}{unseen}")
    out.append(f"sigma_deg = {np.degrees(found.sigmas_rad.max()):.2f}")
    return out


def _offset_lines(camera: CameraConfig, offset: TimeOffset, how: str) -> list[str]:
    if offset.offset_s is None:
        why = f"too little turning, or over {MOST_OFFSET_S * 1e3:.0f} ms; rock the drone by some degrees within seconds"
        if offset.used < LEAST_USED:
            why = f"at least {LEAST_USED} frames with poses all about are needed"
        sigma = f", sigma {offset.sigma_s * 1e3:.0f} ms" if np.isfinite(offset.sigma_s) else ""
        return [f"# the time offset cannot be estimated by the {how} ({offset.used} used{sigma}): {why}"]
    old_ms, late_ms, sigma_ms = camera.source.latency_ms, offset.offset_s * 1e3, offset.sigma_s * 1e3
    measured = (
        f"# frames are stamped {late_ms:+.0f} ms late, sigma {sigma_ms:.0f} ms, by the {how} ({offset.used} used)"
    )
    if old_ms + late_ms < 0.0 and late_ms + 2.0 * sigma_ms < -old_ms:
        return [measured, f"# latency_ms is {old_ms:g} and cannot be below 0: are the recording's stamps right?"]
    new_ms = max(0.0, old_ms + late_ms)
    return [measured, "[camera.source]", f"{f'latency_ms = {new_ms:.0f}':<20}# was {old_ms:g}: {new_ms - old_ms:+.0f}"]


def _one_turn(angle_deg: float) -> float:
    """What the config takes, within 360 degrees of 0."""
    return float(np.fmod(angle_deg, 360.0))
