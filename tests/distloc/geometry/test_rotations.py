import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distloc.geometry.rotations import (
    R_cam_from_enu,
    euler_from_matrix,
    euler_from_quaternion,
    matrix_from_euler,
    matrix_from_quaternion,
    quaternion_from_euler,
    slerp,
)

ANGLES = st.floats(-np.pi, np.pi)
QUARTER = np.pi / 2


@pytest.mark.parametrize(
    ("angles", "rows"),
    [
        ((0.0, 0.0, 0.0), [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        ((QUARTER, 0.0, 0.0), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),  # nose east, right wing south
        ((0.0, QUARTER, 0.0), [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),  # nose up, belly north
        ((0.0, 0.0, QUARTER), [[1, 0, 0], [0, 0, -1], [0, 1, 0]]),  # right wing down, belly west
        ((QUARTER, QUARTER, 0.0), [[0, -1, 0], [0, 0, 1], [-1, 0, 0]]),  # yaw first, then pitch: belly east
    ],
)
def test_quarter_turns_by_hand(angles: tuple[float, float, float], rows: list[list[int]]) -> None:
    assert matrix_from_euler(*angles) == pytest.approx(np.array(rows, dtype=float), abs=1e-12)


@given(ANGLES, ANGLES, ANGLES)
def test_quaternion_and_matrix_are_the_same_rotation(yaw: float, pitch: float, roll: float) -> None:
    matrix = matrix_from_euler(yaw, pitch, roll)
    assert matrix_from_quaternion(3.0 * quaternion_from_euler(yaw, pitch, roll)) == pytest.approx(matrix, abs=1e-9)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(matrix) == pytest.approx(1.0)


@pytest.mark.parametrize("q", [[0.0, 0.0, 0.0, 0.0], [np.nan, 0.0, 0.0, 1.0]])
def test_quaternion_without_length_raises(q: list[float]) -> None:
    with pytest.raises(ValueError, match="quaternion"):
        matrix_from_quaternion(np.array(q))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("share", "yaw_rad"), [(0.0, 0.2), (0.25, 0.4), (1.0, 1.0), (1.5, 1.4)])
def test_slerp_turns_evenly_by_the_shorter_arc(sign: float, share: float, yaw_rad: float) -> None:
    start, end = quaternion_from_euler(0.2, 0.0, 0.0), sign * quaternion_from_euler(1.0, 0.0, 0.0)
    mixed = matrix_from_quaternion(slerp(start, end, share))
    assert mixed == pytest.approx(matrix_from_euler(yaw_rad, 0.0, 0.0), abs=1e-9)


def test_slerp_between_equal_quaternions() -> None:
    q = quaternion_from_euler(0.1, 0.2, 0.3)
    assert slerp(q, q, 0.5) == pytest.approx(q)


def test_level_camera_heading_north() -> None:
    R = R_cam_from_enu(np.eye(3), np.eye(3))
    assert R.tolist() == [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # x east, y down, z north


def test_camera_heading_east_and_mounted_down() -> None:
    heading_east = matrix_from_euler(QUARTER, 0.0, 0.0)
    level = R_cam_from_enu(heading_east, np.eye(3))
    assert level == pytest.approx(np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]], dtype=float), abs=1e-12)
    down = R_cam_from_enu(heading_east, matrix_from_euler(0.0, -QUARTER, 0.0))
    assert down[2] == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)  # looks down
    assert down[1] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)  # the image's lower edge is behind


@given(ANGLES, st.floats(-1.5, 1.5), ANGLES)
def test_euler_angles_there_and_back(yaw: float, pitch: float, roll: float) -> None:
    found = euler_from_quaternion(quaternion_from_euler(yaw, pitch, roll))
    np.testing.assert_allclose(matrix_from_euler(*found), matrix_from_euler(yaw, pitch, roll), atol=1e-9)


@given(ANGLES, st.floats(-1.5, 1.5), ANGLES)
def test_euler_angles_of_a_matrix_there_and_back(yaw: float, pitch: float, roll: float) -> None:
    found = euler_from_matrix(matrix_from_euler(yaw, pitch, roll))
    np.testing.assert_allclose(matrix_from_euler(*found), matrix_from_euler(yaw, pitch, roll), atol=1e-9)


def test_straight_down_all_of_the_turn_is_yaw() -> None:
    yaw, pitch, roll = euler_from_matrix(matrix_from_euler(0.3, -QUARTER, 0.2))
    assert (yaw, pitch, roll) == pytest.approx((0.5, -QUARTER, 0.0), abs=1e-9)
