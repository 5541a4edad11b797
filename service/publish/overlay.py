"""The camera's frame with what was seen drawn into it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from service.localise.stage import Localised

_COLOURS = {"confirmed": (60, 60, 255), "tentative": (0, 200, 255), "coasting": (255, 160, 0)}


def annotated(localised: Localised, camera: Camera) -> NDArray[np.uint8] | None:
    """A copy of the frame with the mask's outline, and a cross and a label for each target in view."""
    image = localised.frame.image
    if image is None:
        return None
    picture = image.copy()
    height, width = picture.shape[:2]
    if localised.mask is not None:
        mask = cv2.resize(localised.mask, (width, height), interpolation=cv2.INTER_NEAREST)
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(picture, contours, -1, (0, 255, 255), 1, cv2.LINE_AA)
    pose = localised.best_pose or localised.pose
    for one in localised.estimates:
        point_cam_m = pose.R_cam_from_enu @ (one.position_enu_m - pose.position_enu_m)
        pixel, visible = camera.project(point_cam_m[:, None])
        if not visible[0]:
            continue
        at = (round(float(pixel[0, 0]) * width / camera.width), round(float(pixel[1, 0]) * height / camera.height))
        colour = _COLOURS.get(str(one.state), (200, 200, 200))
        cv2.drawMarker(picture, at, colour, cv2.MARKER_CROSS, 24, 2, cv2.LINE_AA)
        size = f"+-{one.ellipse95.semi_major_m:.0f} x {one.ellipse95.semi_minor_m:.0f} m"
        label = f"{one.id} {one.state}  {one.range_m / 1000:.2f} km  {size}"
        corner = (at[0] + 18, at[1] - 12)
        (across, up), _ = cv2.getTextSize(label, cv2.FONT_HERSHEY_SIMPLEX, 0.55, 1)
        low, high = (corner[0] - 5, corner[1] - up - 5), (corner[0] + across + 5, corner[1] + 6)
        cv2.rectangle(picture, low, high, (0, 0, 0), -1)
        cv2.putText(picture, label, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1, cv2.LINE_AA)
    return picture


def encoded_png(picture: NDArray[np.uint8]) -> bytes:
    """The picture as a PNG file's bytes."""
    return cv2.imencode(".png", picture)[1].tobytes()


def encoded_jpeg(picture: NDArray[np.uint8]) -> bytes:
    """The picture as a JPEG file's bytes."""
    return cv2.imencode(".jpg", picture)[1].tobytes()
