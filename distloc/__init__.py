"""Where the smoke is, and how sure: localisation of distant targets from one camera's masks."""

from distloc.filter.bootstrap_filter import BootstrapFilter
from distloc.geometry.camera import Camera
from distloc.geometry.triangulate import triangulate_dlt, triangulate_ransac
from distloc.localizer import Localizer, LocalizerConfig
from distloc.sights.detections import detections_from_mask
from distloc.snapshot import LocalizerSnapshot
from distloc.tracks.explanation import Explanation, Lack, TrackExplanation
from distloc.types import CameraPose, Detection, Ellipse, Extent, RejectReason, TargetEstimate, TargetState

__all__ = [
    "BootstrapFilter",
    "Camera",
    "CameraPose",
    "Detection",
    "Ellipse",
    "Explanation",
    "Extent",
    "Lack",
    "Localizer",
    "LocalizerConfig",
    "LocalizerSnapshot",
    "RejectReason",
    "TargetEstimate",
    "TargetState",
    "TrackExplanation",
    "detections_from_mask",
    "triangulate_dlt",
    "triangulate_ransac",
]
