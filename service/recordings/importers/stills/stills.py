"""A folder of pictures, or pictures by their names, as a flight: each was taken where its EXIF and XMP say."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distloc.types import FloatArray
from service.common.files import IMAGE_SUFFIXES
from service.recordings.importers.dji.angles import not_all_zero, quaternions, upright
from service.recordings.importers.flight import (
    Attitudes,
    Fixes,
    Given,
    ImportedFlight,
    ImportRefusedError,
    Lens,
    Positions,
    Remarks,
    Stills,
)
from service.recordings.importers.rows import attitudes_of, count, fixes_of, positions_of
from service.recordings.importers.stills.exif import Exif, NoPictureError, exif_of
from service.recordings.importers.stills.makers import Told, told_by
from service.recordings.importers.stills.times import Times, times_of

_MOST_PICTURES = 100_000
_MOST_ASKED = 20
_SAME_LENS = 0.02
_APART_M = 100.0  # EXIF's digits and a late receiver explain less
_UPRIGHT = 1
_YAW_SIGMA_DEG, _TILT_SIGMA_DEG = 3.0, 1.0  # a compass among motors; a gimbal's own horizon
_YAW_SIGMA_OF_AUTEL_DEG = 5.0  # users measured worse


@dataclass(frozen=True, slots=True)
class _Picture:
    path: Path
    exif: Exif
    told: Told


def read_stills(path: Path, given: Given) -> ImportedFlight:
    """The flight of a folder's pictures, or of all those that were named; ImportRefusedError where there is none."""
    remarks = Remarks()
    pictures = _of_one_lens(_read(path, _paths(path, given), remarks), remarks)
    if not pictures:
        why = ", ".join(f"{number} {reason}" for reason, number in sorted(remarks.dropped.items()))
        raise ImportRefusedError(f"{path}: no picture that tells when it was taken{': ' if why else ''}{why}")
    times = times_of([one.exif for one in pictures], [one.path.name for one in pictures], given, remarks)
    pictures = [pictures[number] for number in times.order]
    told = [one.told for one in pictures]
    _doubt_places(told, remarks)
    positions, fixes = _track(told, times, remarks)
    camera, craft = _attitudes(told, times, remarks)
    is_autel = any("autel" in one.exif.make.lower() for one in pictures)
    return ImportedFlight(
        _name(path, [one.path for one in pictures]),
        times.epoch_s,
        positions=positions,
        camera=camera,
        craft=craft,
        fixes=fixes,
        lens=_lens(pictures, remarks),
        frames=Stills([one.path for one in pictures], times.time_s),
        frames_tied=positions is not None or times.is_sure,
        yaw_sigma_deg=_YAW_SIGMA_OF_AUTEL_DEG if is_autel else _YAW_SIGMA_DEG,
        tilt_sigma_deg=None if camera is None else _TILT_SIGMA_DEG,
        needs_mount=camera is None,
        remarks=remarks,
    )


def _name(path: Path, paths: Sequence[Path]) -> str:
    if path.is_dir() or len(paths) == 1:
        return path.resolve().name
    return f"{paths[0].name} and {len(paths) - 1} more"


def is_picture(suffix: str) -> bool:
    """Whether a file is taken for a picture by its name."""
    return suffix in IMAGE_SUFFIXES


def has_stills(folder: Path) -> bool:
    """Whether a folder's pictures have EXIF: else, or with a table of their times, they are a recording's frames."""
    if not folder.is_dir() or (folder / "frames.csv").exists():
        return False
    for path in _paths(folder, Given())[:_MOST_ASKED]:
        try:
            exif = exif_of(path)
        except NoPictureError:
            continue
        if exif.local_s is not None or exif.gps_s is not None:
            return True
    return False


def _some(paths: Iterable[Path]) -> list[Path]:
    return [path for path, _ in zip(paths, range(2 * _MOST_PICTURES), strict=False)]


def _paths(path: Path, given: Given) -> list[Path]:
    if not path.is_dir():
        return list(given.stills) or [path]
    try:
        found = [one for one in _some(path.iterdir()) if is_picture(one.suffix.lower()) and one.name[0] != "."]
    except OSError as error:
        raise ImportRefusedError(f"{path}: cannot be read: {error.strerror}") from error
    return sorted(found)


def _read(source: Path, paths: Sequence[Path], remarks: Remarks) -> list[_Picture]:
    if len(paths) > _MOST_PICTURES:
        raise ImportRefusedError(f"{source}: more than {_MOST_PICTURES} pictures")
    pictures: list[_Picture] = []
    for path in paths:
        try:
            exif = exif_of(path)
        except NoPictureError as error:
            count(remarks, f"picture: {error}")
            continue
        if exif.local_s is None and exif.gps_s is None:
            count(remarks, "picture: no time in its EXIF")
        elif exif.orientation != _UPRIGHT:
            count(remarks, "picture: turned by its EXIF: which way its camera was is not told")
        else:
            pictures.append(_Picture(path, exif, told_by(exif)))
    return pictures


def _of_one_lens(pictures: list[_Picture], remarks: Remarks) -> list[_Picture]:
    """Those of the camera and zoom that took most: a drone of three cameras puts all its pictures into one folder."""
    if not pictures:
        return pictures
    size, _ = Counter((one.exif.width, one.exif.height) for one in pictures).most_common(1)[0]
    same = [one for one in pictures if (one.exif.width, one.exif.height) == size]
    focal_px = Counter(round(one.told.focal_px, 1) for one in same if math.isfinite(one.told.focal_px))
    if focal_px:
        usual_px = focal_px.most_common(1)[0][0]
        same = [one for one in same if not abs(one.told.focal_px / usual_px - 1.0) > _SAME_LENS]
    count(remarks, "picture: of another camera, size or zoom than most", len(pictures) - len(same))
    return same


def _lens(pictures: Sequence[_Picture], remarks: Remarks) -> Lens:
    exif = pictures[0].exif
    models = Counter(f"{one.exif.make} {one.exif.model}".strip() or "an unnamed camera" for one in pictures)
    remarks.found.append("pictures of " + ", ".join(f"{name} ({number})" for name, number in models.most_common(3)))
    focal_px = [one.told.focal_px for one in pictures if math.isfinite(one.told.focal_px)]
    if not focal_px:
        remarks.lacks.append("focal length: --hfov DEGREES, or --config FILE with a [camera]")
        return Lens(exif.width, exif.height)
    fx = float(np.median(focal_px))
    hfov_deg = math.degrees(2.0 * math.atan(exif.width / 2.0 / fx))
    if any(one.told.is_calibrated for one in pictures):
        remarks.found.append(f"lens: the maker's calibration, {fx:.0f} px, {hfov_deg:.1f} degrees across")
    else:
        remarks.assumed.append(f"field of view {hfov_deg:.1f} degrees across, by the focal length: right to some 4 %")
    return Lens(exif.width, exif.height, fx=fx)


def _track(told: Sequence[Told], times: Times, remarks: Remarks) -> tuple[Positions | None, Fixes | None]:
    lat, lon, msl, ellipsoid, above = np.array(
        [(one.lat_deg, one.lon_deg, one.alt_msl_m, one.alt_ellipsoid_m, one.above_home_m) for one in told]
    ).T
    positions = positions_of(
        times.time_s, lat, lon, remarks, alt_msl_m=msl, alt_ellipsoid_m=ellipsoid, above_home_m=above
    )
    if positions is None:
        remarks.lacks.append("places: a log or a table beside the pictures must tell them")
        return None, None
    if np.isfinite(msl).any():
        remarks.assumed.append(
            "heights above the sea are the barometer's, at times tens of metres wrong: only used without --home-alt"
        )
    if np.isfinite(ellipsoid).any():
        remarks.assumed.append("heights are over the ellipsoid, as RTK and Skydio write them: --geoid")
    fixes = fixes_of(
        times.time_s,
        [one.fix_type for one in told],
        remarks,
        h_acc_m=np.array([one.h_acc_m for one in told]),
    )
    return positions, fixes


def _doubt_places(told: Sequence[Told], remarks: Remarks) -> None:
    """Say it where XMP and EXIF contradict each other: which one is wrong only the user knows."""
    apart_m = np.array([one.apart_m for one in told])
    is_far = apart_m > _APART_M
    if is_far.any():
        remarks.doubt.append(
            f"{int(is_far.sum())} of {len(told)} pictures: EXIF has them up to "
            f"{float(apart_m[is_far].max()) / 1000:.1f} km from where XMP has them: XMP is taken; did you "
            "fly there?"
        )


def _attitudes(told: Sequence[Told], times: Times, remarks: Remarks) -> tuple[Attitudes | None, Attitudes | None]:
    camera_deg = upright(not_all_zero(np.stack([one.camera_deg for one in told]), remarks), remarks)
    count(remarks, "attitude: an angle of the camera that is no number", sum(one.is_spoilt for one in told))
    if any(one.from_pix4d and np.isfinite(one.camera_deg).all() for one in told):
        remarks.assumed.append("Camera:Pitch 0 looks straight down, as Pix4D has it: some mean the horizon")
    unclear = sum(one.from_pix4d and not np.isfinite(one.camera_deg).all() for one in told)
    count(remarks, "attitude: Camera:Pitch far below 0, which Pix4D's zero does not explain", unclear)
    camera = _finite(times.time_s, camera_deg, remarks)
    craft = _finite(times.time_s, np.stack([one.craft_deg for one in told]), remarks)
    if camera is not None:
        remarks.found.append(f"the camera's angles from north, of {len(camera.time_s)} of {len(told)} pictures")
    elif craft is not None:
        remarks.lacks.append("the camera's angles: the craft's are told, --mount must say how the camera sat in it")
    else:
        remarks.lacks.append("the camera's attitude: --attitude FILE must tell it")
    return camera, craft


def _finite(time_s: FloatArray, angles_deg: FloatArray, remarks: Remarks) -> Attitudes | None:
    is_told = np.isfinite(angles_deg).all(axis=1)
    return attitudes_of(time_s[is_told], quaternions(angles_deg[is_told]), remarks) if is_told.any() else None
