"""The poses of an imported recording's frames, as the code that flies has them."""

from pathlib import Path

from distloc.geometry.rotations import R_ENU_FROM_NED, R_FRD_FROM_CAM
from distloc.types import FloatArray
from service.config.load import load_config
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording


def poses_of(folder: Path) -> list[tuple[float, tuple[float, float, float], FloatArray]]:
    """Of each frame with a pose: seconds after the first frame's stamp, latitude, longitude and height over the sea,

    and R_ned_from_frd (3, 3) of the camera.
    """
    recording = Recording(folder)
    posed = PosedFrames(recording, load_config(folder / "config.toml"))
    first_us = recording.frames()[0][0]
    found = []
    for frame, pose in posed.pairs(lambda stamp_ns: None):
        frame_enu = posed.autopilot.frame_enu
        assert frame_enu is not None
        R = R_ENU_FROM_NED.T @ pose.R_cam_from_enu.T @ R_FRD_FROM_CAM.T
        found.append(((frame.stamp_ns // 1000 - first_us) * 1e-6, frame_enu.geodetic_from_enu(pose.position_enu_m), R))
    recording.close()
    return found
