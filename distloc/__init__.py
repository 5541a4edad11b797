"""Where the smoke is, and how sure: localisation of distant targets from one camera's masks.

Names are imported when they are first asked for, so that `import distloc` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from distloc.batch.locate import locate
    from distloc.batch.place import Bearing, Further, Located, Place, Rejected, Unused
    from distloc.batch.sighting import Sighting, direction_from_azimuth, direction_from_pixel
    from distloc.filter.bootstrap_filter import BootstrapFilter
    from distloc.filter.ground import FlatGround, GridGround, Ground, NoGround
    from distloc.filter.uncertainty import ellipse_holds
    from distloc.geometry.camera import Camera
    from distloc.geometry.geodesy import LocalFrame
    from distloc.geometry.rotations import (
        R_cam_from_enu,
        matrix_from_euler,
        matrix_from_quaternion,
        matrix_from_rotation_vector,
    )
    from distloc.geometry.triangulate import triangulate_dlt, triangulate_ransac
    from distloc.localizer import Localizer, LocalizerConfig
    from distloc.sights.detections import detections_from_mask
    from distloc.snapshot import LocalizerSnapshot
    from distloc.tracks.explanation import Explanation, Lack, TrackExplanation
    from distloc.types import (
        CameraPose,
        Detection,
        Ellipse,
        Extent,
        Plume,
        PoseErrors,
        RejectReason,
        TargetEstimate,
        TargetState,
    )

__all__ = [
    "Bearing",
    "BootstrapFilter",
    "Camera",
    "CameraPose",
    "Detection",
    "Ellipse",
    "Explanation",
    "Extent",
    "FlatGround",
    "Further",
    "GridGround",
    "Ground",
    "Lack",
    "LocalFrame",
    "Localizer",
    "LocalizerConfig",
    "LocalizerSnapshot",
    "Located",
    "NoGround",
    "Place",
    "Plume",
    "PoseErrors",
    "R_cam_from_enu",
    "RejectReason",
    "Rejected",
    "Sighting",
    "TargetEstimate",
    "TargetState",
    "TrackExplanation",
    "Unused",
    "detections_from_mask",
    "direction_from_azimuth",
    "direction_from_pixel",
    "ellipse_holds",
    "locate",
    "matrix_from_euler",
    "matrix_from_quaternion",
    "matrix_from_rotation_vector",
    "triangulate_dlt",
    "triangulate_ransac",
]

_HOME = {
    **dict.fromkeys(("locate",), "distloc.batch.locate"),
    **dict.fromkeys(("Bearing", "Further", "Located", "Place", "Rejected", "Unused"), "distloc.batch.place"),
    **dict.fromkeys(("Sighting", "direction_from_azimuth", "direction_from_pixel"), "distloc.batch.sighting"),
    **dict.fromkeys(("BootstrapFilter",), "distloc.filter.bootstrap_filter"),
    **dict.fromkeys(("FlatGround", "GridGround", "Ground", "NoGround"), "distloc.filter.ground"),
    **dict.fromkeys(("ellipse_holds",), "distloc.filter.uncertainty"),
    **dict.fromkeys(("Camera",), "distloc.geometry.camera"),
    **dict.fromkeys(("LocalFrame",), "distloc.geometry.geodesy"),
    **dict.fromkeys(
        ("R_cam_from_enu", "matrix_from_euler", "matrix_from_quaternion", "matrix_from_rotation_vector"),
        "distloc.geometry.rotations",
    ),
    **dict.fromkeys(("triangulate_dlt", "triangulate_ransac"), "distloc.geometry.triangulate"),
    **dict.fromkeys(("Localizer", "LocalizerConfig"), "distloc.localizer"),
    **dict.fromkeys(("detections_from_mask",), "distloc.sights.detections"),
    **dict.fromkeys(("LocalizerSnapshot",), "distloc.snapshot"),
    **dict.fromkeys(("Explanation", "Lack", "TrackExplanation"), "distloc.tracks.explanation"),
    **dict.fromkeys(
        ("CameraPose", "Detection", "Ellipse", "Extent", "Plume", "PoseErrors"),
        "distloc.types",
    ),
    **dict.fromkeys(("RejectReason", "TargetEstimate", "TargetState"), "distloc.types"),
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'distloc' has no attribute {name!r}")
    found = getattr(import_module(_HOME[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
