"""One target followed by the paper's filter, as the paper does; a dismissed target's filter starts again."""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.filter.bootstrap_filter import BootstrapFilter
from distloc.filter.settings import LocalizerConfig
from distloc.filter.uncertainty import LEVEL, TAILS, credible_ellipse, grown
from distloc.geometry.camera import Camera
from distloc.tracks.explanation import Explanation, Lack, TrackExplanation
from distloc.tracks.life import TrackLife
from distloc.types import CameraPose, Detection, Extent, FloatArray, MaskArray, TargetEstimate, TargetState


class BootstrapTracker:
    """Steps the bootstrap filter and its target's life. The localizer calls it."""

    def __init__(self, camera: Camera, config: LocalizerConfig, rng: np.random.Generator) -> None:
        self._camera, self._config = camera, config
        self._filter = BootstrapFilter(camera, config.n_particles, config.particle_sigma_m, rng, config.range_m)
        self._track: TrackLife | None = None
        self._extent = Extent(0.0, 0.0, 0.0, 0.0)
        self._next_id = 1

    def step(self, pose: CameraPose, mask: MaskArray | None, detections: list[Detection]) -> list[TargetEstimate]:
        """One filter step; without a mask each detection is drawn as the ellipse of its second moments."""
        if self._track is None and not detections:
            return []
        return self._filter_step(pose, self._drawn(detections) if mask is None else mask, detections)

    def explain(self, camera_enu_m: FloatArray) -> Explanation:
        """The one target, as seen from a camera after a step, and why it is not confirmed."""
        life = self._track
        if life is None:
            return Explanation(places=1)
        lacks = (Lack.BASELINE if life.is_seen_enough else Lack.SIGHTINGS,)
        is_believed = life.state is not TargetState.TENTATIVE
        ranges_m = np.linalg.norm(self._filter.particles_enu_m - camera_enu_m[:, None], axis=0)
        low_m, high_m = np.quantile(ranges_m, TAILS).tolist()
        one = TrackExplanation(life.id, life.state, life.sightings, (low_m, high_m), () if is_believed else lacks)
        return Explanation(tracks=(one,), places=1, places_used=1)

    def particles_enu_m(self, target_id: int) -> FloatArray | None:
        """The particles (3, N) of the live target; a view: don't write into it."""
        return self._filter.particles_enu_m if self._track and self._track.id == target_id else None

    def _drawn(self, detections: list[Detection]) -> NDArray[np.uint8]:
        mask: NDArray[np.uint8] = np.zeros((self._camera.height, self._camera.width), dtype=np.uint8)
        for detection in detections:
            values, vectors = np.linalg.eigh(detection.covariance_px2)
            axes = np.maximum(2.0 * np.sqrt(np.maximum(values, 0.0)), 2.0)
            angle_deg = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
            centre = (float(detection.centre_px[0]), float(detection.centre_px[1]))
            cv2.ellipse(mask, (centre, (2 * float(axes[1]), 2 * float(axes[0])), angle_deg), 255, -1)
        return mask

    def _filter_step(self, pose: CameraPose, mask: MaskArray, detections: list[Detection]) -> list[TargetEstimate]:
        if self._track is None:
            self._filter.start(pose, detections[0].centre_px)
            self._track = TrackLife(self._next_id, pose.stamp_s, pose.position_enu_m)
            self._next_id += 1
        self._filter.predict()
        is_match = self._filter.update(pose, mask)
        mean_enu_m = self._filter.particles_enu_m.mean(axis=1)
        if is_match is not None or self._is_in_view(pose, mean_enu_m):
            self._track.sighting(bool(is_match), pose.stamp_s, pose.position_enu_m)
        if is_match:
            self._measure_extent(pose, mean_enu_m, detections)
        estimate = self._estimated(pose, mean_enu_m, self._track, bool(is_match))
        if self._filter.misses >= self._config.dismissal_misses:
            self._track = None
        return [estimate]

    def _is_in_view(self, pose: CameraPose, point_enu_m: FloatArray) -> bool:
        point_cam_m = pose.R_cam_from_enu @ (point_enu_m - pose.position_enu_m)
        return bool(self._camera.project(point_cam_m[:, None])[1][0])

    def _measure_extent(self, pose: CameraPose, mean_enu_m: FloatArray, detections: list[Detection]) -> None:
        pixel, _ = self._camera.project((pose.R_cam_from_enu @ (mean_enu_m - pose.position_enu_m))[:, None])
        if not detections:
            return
        nearest = min(detections, key=lambda detection: float(np.linalg.norm(detection.centre_px - pixel[:, 0])))
        ranges_m = np.linalg.norm(self._filter.particles_enu_m - pose.position_enu_m[:, None], axis=0)
        range_m, sigma_m = float(ranges_m.mean()), float(ranges_m.std())
        across, up = nearest.width_px / self._camera.fx, nearest.height_px / self._camera.fy
        self._extent = Extent(range_m * across, sigma_m * across, range_m * up, sigma_m * up)

    def _estimated(self, pose: CameraPose, mean_enu_m: FloatArray, track: TrackLife, is_seen: bool) -> TargetEstimate:
        particles = self._filter.particles_enu_m
        centred = particles - mean_enu_m[:, None]
        ellipse = credible_ellipse(particles[:2])
        offset_enu_m = mean_enu_m - pose.position_enu_m
        ranges_m = np.linalg.norm(particles - pose.position_enu_m[:, None], axis=0)
        low_m, high_m = np.quantile(ranges_m, TAILS)
        range_m = float(np.linalg.norm(offset_enu_m))
        track.settle(is_seen, ellipse.semi_major_m / max(range_m, 1.0))
        is_dismissed = self._filter.misses >= self._config.dismissal_misses
        return TargetEstimate(
            id=track.id,
            state=TargetState.DISMISSED if is_dismissed else track.state,
            position_enu_m=mean_enu_m,
            covariance_enu_m2=centred @ centred.T / centred.shape[1],
            ellipse95=ellipse,
            vertical95_m=float(np.quantile(np.abs(centred[2]), LEVEL)),
            region95=grown(ellipse, self._extent.width_m / 2.0),
            extent=self._extent,
            range_m=range_m,
            range95_m=(float(low_m), float(high_m)),
            bearing_rad=float(np.arctan2(offset_enu_m[0], offset_enu_m[1]) % (2 * np.pi)),
            existence=track.existence,
            observations=track.observations,
            misses=track.misses,
            baseline_m=track.baseline_m,
            first_seen_s=track.first_seen_s,
            last_seen_s=track.last_seen_s,
        )
