"""How far a silhouette's centre alone leads astray: DLT from other centres of the same noiseless cube.

Seen obliquely the near face dominates the silhouette, so no centre of a segment is the projection of the cube's centre.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from distloc.geometry.triangulate import triangulate_dlt
from distloc.sights.sights import bisector_px
from distloc.simulation.targets import Box
from distloc.study.methods import box_centre_px
from distloc.study.scenes import Scene
from distloc.study.table1.cells import is_counted
from distloc.types import CameraPose, FloatArray


@dataclass(frozen=True, slots=True)
class SilhouetteRow:
    """Error of DLT against the cube's centre from one kind of centre; `is_segment` if a segmenter could give it."""

    centre: str
    is_segment: bool
    mean_m: float
    end_m: float


def silhouette_rows(scene: Scene, translation: FloatArray) -> list[SilhouetteRow]:
    """Each kind of centre: mean error over the frames that count, and at the end of the flight."""
    target = scene.target
    assert isinstance(target, Box)
    poses = [scene.flight.pose_at(float(stamp_s)) for stamp_s in scene.flight.stamps_s]
    kinds = {
        "segment: centre of its box": (True, [_mask_box(scene, pose) for pose in poses]),
        "segment: middle ray between its edges": (True, [_mask_bisector(scene, pose) for pose in poses]),
        "segment: centroid of its area": (True, [_mask_centroid(scene, pose) for pose in poses]),
        "exact corners: centre of their box": (False, [_corner_box(scene, target, pose) for pose in poses]),
        "exact corners: centroid of the hull": (False, [_hull_centroid(scene, target, pose) for pose in poses]),
        "exact corners: mean of the eight": (False, [_corners(scene, target, pose).mean(axis=1) for pose in poses]),
    }
    rows = []
    for name, (is_segment, pixels) in kinds.items():
        errors_m = _errors_m(scene, poses, np.stack(pixels, axis=1))
        rows.append(
            SilhouetteRow(name, is_segment, float(errors_m[is_counted(translation)].mean()), float(errors_m[-1]))
        )
    return rows


def _errors_m(scene: Scene, poses: list[CameraPose], pixels: FloatArray) -> FloatArray:
    errors_m = np.full(len(poses), np.nan)
    for n in range(2, len(poses) + 1):
        point = triangulate_dlt(scene.camera, poses[:n], pixels[:, :n])
        if isinstance(point, np.ndarray):
            errors_m[n - 1] = np.linalg.norm(point - scene.target.centre_enu_m(poses[n - 1].stamp_s))
    return errors_m


def _mask(scene: Scene, pose: CameraPose) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    mask = np.zeros((scene.camera.height, scene.camera.width), np.uint8)
    scene.target.draw(mask, scene.camera, pose)
    return mask


def _mask_box(scene: Scene, pose: CameraPose) -> FloatArray:
    centre = box_centre_px(_mask(scene, pose), scene.camera)
    assert centre is not None
    return centre


def _mask_bisector(scene: Scene, pose: CameraPose) -> FloatArray:
    _, _, width, height = cv2.boundingRect(_mask(scene, pose))
    return bisector_px(scene.camera, _mask_box(scene, pose), np.array([width, height], np.float64))


def _mask_centroid(scene: Scene, pose: CameraPose) -> FloatArray:
    rows, columns = np.nonzero(_mask(scene, pose))
    return np.array([columns.mean(), rows.mean()])


def _corners(scene: Scene, target: Box, pose: CameraPose) -> FloatArray:
    corners = target.corners_px(scene.camera, pose)
    assert corners is not None
    return corners


def _corner_box(scene: Scene, target: Box, pose: CameraPose) -> FloatArray:
    corners = _corners(scene, target, pose)
    return np.asarray((corners.min(axis=1) + corners.max(axis=1)) / 2.0)


def _hull_centroid(scene: Scene, target: Box, pose: CameraPose) -> FloatArray:
    corners = _corners(scene, target, pose)
    origin = corners.mean(axis=1)
    moments = cv2.moments(cv2.convexHull((corners - origin[:, None]).T.astype(np.float32)))
    return np.asarray(origin + np.array([moments["m10"], moments["m01"]]) / moments["m00"])
