"""What is known of a target in the form that further sights are foretold from; `distloc.advice` asks for it."""

from dataclasses import dataclass

import numpy as np

from distloc.filter.turning import Views
from distloc.filter.uncertainty import weighted_quantile
from distloc.sights.sight import NUISANCES
from distloc.tracks.target_track import Track
from distloc.types import CameraPose, FloatArray, PoseErrors

_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the probability, nearer than which the target is


@dataclass(frozen=True, slots=True)
class Outlook:
    """A target as seen from the camera at `pose`, and what its next sights are like.

    `axes` (3, 3) are right, up and along to its mean. `covariance` (8, 8) is of the range's logarithm, of the tangents
    right and up, and of the nuisances: the attitude's bias about east, north and up, and the aim's error right and up.
    `ranges_m` (5,) are quantiles of its range, each as likely as the others. `white_rad2` (2, 2) is a sight's own
    covariance, `aim_sigma_rad` (2,) the aim's, `sightings` how many there were. `also_m2` (2, 2) is what the ellipse
    has beside the cloud, and `views` tell what errors that turn with the heading add to that.
    """

    id: int
    pose: CameraPose
    errors: PoseErrors
    axes: FloatArray
    covariance: FloatArray
    ranges_m: FloatArray
    white_rad2: FloatArray
    aim_sigma_rad: FloatArray
    sightings: int
    also_m2: FloatArray
    views: Views


def outlook_of(track: Track, pose: CameraPose, errors: PoseErrors) -> Outlook | None:
    """None for a target that has no number, or that was not seen in its last frames."""
    rays = [frame.ray for frame in track.memory.frames if frame.ray is not None]
    if track.life is None or not rays:
        return None
    filter_, bank = track.filter, track.filter.bank
    places = np.array([filter_.place])
    x, weights = (one[0].astype(np.float64) for one in bank.particles.sampled(places))
    offsets_m = x[:3] + (bank.particles.origin_enu_m[filter_.place] - pose.position_enu_m)[:, None]
    nuisances = x[3:] * bank.particles.scale[filter_.place, :NUISANCES, None]
    ranges_m = np.maximum(np.linalg.norm(offsets_m, axis=0), 1.0)
    axes = _axes((offsets_m / ranges_m) @ weights)
    tangents = axes[:2] @ offsets_m / np.maximum(axes[2] @ offsets_m, 1.0)
    state = np.concatenate([np.log(ranges_m)[None], tangents, nuisances])
    centred = state - (state @ weights)[:, None]
    covariance = (centred * weights) @ centred.T
    covariance[3:, 3:] += bank.P[filter_.place, :NUISANCES, :NUISANCES]
    views = track.belief.views.all
    return Outlook(
        id=track.life.id,
        pose=pose,
        errors=errors,
        axes=axes,
        covariance=covariance,
        ranges_m=np.array([weighted_quantile(ranges_m, weights, share) for share in _SHARES]),
        white_rad2=track.belief.sight(rays[-1]).covariance,
        aim_sigma_rad=bank.aim_sigma_rad[filter_.place].copy(),
        sightings=track.life.observations,
        also_m2=track.also_m2(pose, np.zeros((2, 2)), errors),
        views=views[-1].with_more(np.zeros((0, 4)), np.zeros(0)) if views else Views(),
    )


def _axes(along_enu: FloatArray) -> FloatArray:
    """Right, up and along (3, 3) of a direction."""
    along = along_enu / max(float(np.linalg.norm(along_enu)), 1e-9)
    right = np.cross(along, [0.0, 0.0, 1.0])
    right = right / max(float(np.linalg.norm(right)), 1e-9) if np.linalg.norm(right) > 1e-6 else np.array([1.0, 0, 0])
    return np.stack([right, np.cross(right, along), along])
