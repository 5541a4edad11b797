"""Rotations as matrices and unit quaternions (w, x, y, z), for attitudes and camera mounts.

Matrices read by cancelling: `R_ned_from_body @ v_body` gives `v_ned`.
"""

import math

import cv2
import numpy as np

from distloc.types import FloatArray

R_ENU_FROM_NED: FloatArray = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# The camera's z looks along the body's x (forward), its x along y (right), its y along z (down).
R_FRD_FROM_CAM: FloatArray = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

_STRAIGHT_DOWN = 1e-6  # a cosine of the pitch so small tells no yaw


def skew(v: FloatArray) -> FloatArray:
    """The matrix (3, 3) by which `skew(v) @ u` is the cross product of v (3,) and u (3,) or (3, N)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def matrix_from_euler(yaw_rad: float, pitch_rad: float, roll_rad: float) -> FloatArray:
    """R_parent_from_child (3, 3) for intrinsic yaw, pitch, roll (z, y, x), as MAVLink's ATTITUDE has it."""
    cy, sy = np.cos(yaw_rad), np.sin(yaw_rad)
    cp, sp = np.cos(pitch_rad), np.sin(pitch_rad)
    cr, sr = np.cos(roll_rad), np.sin(roll_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def quaternion_from_euler(
    yaw_rad: float | FloatArray, pitch_rad: float | FloatArray, roll_rad: float | FloatArray
) -> FloatArray:
    """Unit quaternion (4,) w, x, y, z of the same rotation as `matrix_from_euler`; (4, N) of angles (N,)."""
    cy, sy = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2)
    cp, sp = np.cos(pitch_rad / 2), np.sin(pitch_rad / 2)
    cr, sr = np.cos(roll_rad / 2), np.sin(roll_rad / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def euler_from_quaternion(q_wxyz: FloatArray) -> tuple[float, float, float]:
    """Yaw, pitch and roll of a unit quaternion (4,); straight up or down only their sum or difference is told apart."""
    w, x, y, z = (float(part) for part in q_wxyz)
    yaw_rad = float(np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z))
    pitch_rad = float(np.arcsin(np.clip(2 * (w * y - x * z), -1.0, 1.0)))
    roll_rad = float(np.arctan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z))
    return yaw_rad, pitch_rad, roll_rad


def euler_from_matrix(R_parent_from_child: FloatArray) -> tuple[float, float, float]:
    """Yaw, pitch and roll of `matrix_from_euler`'s matrix (3, 3); straight up or down all of the turn is yaw."""
    R = R_parent_from_child
    pitch_rad = -float(np.arcsin(np.clip(R[2, 0], -1.0, 1.0)))
    if math.hypot(R[0, 0], R[1, 0]) < _STRAIGHT_DOWN:
        return math.atan2(-R[0, 1], R[1, 1]), pitch_rad, 0.0
    return math.atan2(R[1, 0], R[0, 0]), pitch_rad, math.atan2(R[2, 1], R[2, 2])


def matrix_from_quaternion(q_wxyz: FloatArray) -> FloatArray:
    """Rotation matrix (3, 3) of a quaternion (4,), which is normalised first."""
    norm = float(np.linalg.norm(q_wxyz))
    if not np.isfinite(norm) or norm < 1e-9:
        raise ValueError(f"a quaternion must have a finite length above 0, got {q_wxyz}")
    w, x, y, z = q_wxyz / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def matrix_from_rotation_vector(vector_rad: FloatArray) -> FloatArray:
    """Rotation matrix (3, 3) about a vector (3,) by its length in radians (Rodrigues)."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector_rad, dtype=np.float64))[0])


def slerp(q_start: FloatArray, q_end: FloatArray, share: float) -> FloatArray:
    """Quaternion (4,) at `share` of the way from start to end by the shorter arc; a share above 1 extrapolates."""
    cosine = float(q_start @ q_end)
    if cosine < 0.0:
        q_end, cosine = -q_end, -cosine
    if cosine > 1.0 - 1e-10:
        mixed = q_start + share * (q_end - q_start)
        return np.asarray(mixed / np.linalg.norm(mixed))
    angle = np.arccos(cosine)
    return np.asarray((np.sin((1 - share) * angle) * q_start + np.sin(share * angle) * q_end) / np.sin(angle))


def heading_rad(R_ned_from_body: FloatArray) -> float:
    """Where a craft's nose points, clockwise from north, from 0 to 2 pi."""
    return math.atan2(R_ned_from_body[1, 0], R_ned_from_body[0, 0]) % (2.0 * math.pi)


def R_cam_from_enu(R_ned_from_body: FloatArray, R_body_from_mount: FloatArray) -> FloatArray:
    """The camera's orientation (3, 3) from the vehicle's (or gimbal's) and the mount's fixed angles."""
    R_enu_from_cam = R_ENU_FROM_NED @ R_ned_from_body @ R_body_from_mount @ R_FRD_FROM_CAM
    return np.ascontiguousarray(R_enu_from_cam.T)


def crossed(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross products (..., 3) of vectors, in a third of the time that NumPy's take for few."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
