"""The config of an imported recording: what its source tells of lens, mount and errors, beside a user's own. Pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from service.recordings.importers.flight import ImportedFlight
from service.recordings.importers.output.resampling import Resampled

# As [pose_errors] has them for a consumer's drone; what is filled in adds to its own.
_WHITE_DEG, _POSITION_M = 0.1, 1.0
HEADING_DEG, TILT_DEG = 2.0, 0.5
UNKNOWN_MOUNT_DEG = 20.0  # of a camera that is taken to look ahead: most look down by up to 30 degrees


@dataclass(frozen=True, slots=True)
class Mount:
    """Angles of the camera in the body, or in the gimbal; `sigma_deg` None where not told."""

    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    sigma_deg: float | None = None


def config_text(
    flight: ImportedFlight,
    mount: Mount,
    attitudes: Resampled,
    positions: Resampled,
    given: str,
    has: Mapping[str, object],
) -> str:
    """TOML: the user's text, with the sections that it lacks; `has` is its content."""
    camera = has.get("camera")
    parts = [given.rstrip() + "\n"] if given.strip() else []
    if not isinstance(camera, dict):
        parts.append(_camera(flight))
    if not isinstance(camera, dict) or "mount" not in camera:
        parts.append(_mount(flight, mount))
    errors = _errors(flight, mount, attitudes, positions)
    if "pose_errors" not in has and errors:
        parts.append(errors)
    return "\n".join(parts)


def sized_errors(flight: ImportedFlight, mount: Mount, attitudes: Resampled, positions: Resampled) -> dict[str, float]:
    """The keys of [pose_errors] that differ from a consumer's drone's."""
    sizes: dict[str, float] = {}
    mount_deg = mount.sigma_deg or 0.0
    for key, usual, told in (
        ("heading_bias_deg", HEADING_DEG, flight.yaw_sigma_deg),
        ("tilt_bias_deg", TILT_DEG, flight.tilt_sigma_deg),
    ):
        size = math.hypot(usual if told is None else told, mount_deg)
        if told is not None or mount_deg > 0.5 * usual:
            sizes[key] = min(90.0, size)
    if attitudes.error > 0.0:
        sizes["attitude_white_deg"] = min(90.0, math.hypot(_WHITE_DEG, math.degrees(attitudes.error)))
    step_m = flight.position_step_m or 0.0
    position_m = math.hypot(_POSITION_M, positions.error, step_m / 2.0)  # a cut-off digit is to one side all along
    if position_m > 1.02 * _POSITION_M or positions.error > 0.0:
        sizes["position_m"] = min(1000.0, position_m)
    return sizes


def _camera(flight: ImportedFlight) -> str:
    lens = flight.lens
    if lens is None:
        return "# no frames: no camera"
    lines = ["[camera]", f"width = {lens.width}", f"height = {lens.height}"]
    if lens.fx is not None:
        middle = ((lens.width - 1) / 2.0, (lens.height - 1) / 2.0)
        lines += [
            f"{key} = {value:.2f}"
            for key, value in zip(("fx", "fy", "cx", "cy"), (lens.fx, lens.fx, *middle), strict=True)
        ]
    elif lens.hfov_deg is not None:
        lines.append(f"hfov_deg = {lens.hfov_deg:.3f}")
    return "\n".join(lines) + "\n"


def _mount(flight: ImportedFlight, mount: Mount) -> str:
    lines = ["[camera.mount]"]
    lines += [f"{name}_deg = {getattr(mount, f'{name}_deg'):g}" for name in ("yaw", "pitch", "roll")]
    if mount.sigma_deg is not None:
        lines.append(f"sigma_deg = {mount.sigma_deg:g}")
    if flight.gimbal is not None:
        lines.append("gimbal = true")
    return "\n".join(lines) + "\n"


def _errors(flight: ImportedFlight, mount: Mount, attitudes: Resampled, positions: Resampled) -> str:
    sizes = sized_errors(flight, mount, attitudes, positions)
    if not sizes:
        return ""
    return "\n".join(["[pose_errors]", *(f"{key} = {value:.3f}" for key, value in sizes.items())]) + "\n"
