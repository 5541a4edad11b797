"""Where the smoke is, and how sure: localisation of distant targets from one camera's masks."""

from distloc.bootstrap_filter import BootstrapFilter
from distloc.camera import Camera
from distloc.detections import detections_from_mask
from distloc.localizer import Localizer, LocalizerConfig
from distloc.snapshot import LocalizerSnapshot
from distloc.triangulate import triangulate_dlt, triangulate_ransac
from distloc.types import CameraPose, Detection, Ellipse, Extent, RejectReason, TargetEstimate, TargetState

__all__ = [
    "BootstrapFilter",
    "Camera",
    "CameraPose",
    "Detection",
    "Ellipse",
    "Extent",
    "Localizer",
    "LocalizerConfig",
    "LocalizerSnapshot",
    "RejectReason",
    "TargetEstimate",
    "TargetState",
    "detections_from_mask",
    "triangulate_dlt",
    "triangulate_ransac",
]
