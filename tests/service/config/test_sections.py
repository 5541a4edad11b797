from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from service.config.landmarks import template_bytes
from service.config.load import load_config
from service.config.sections import ConfigError


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("bogus = 1", "bogus`; it may have vehicle, camera, mavlink"),
        ("[camera]\nfx = -1.5", "camera.fx is -1.5: expected `float` > 0.0"),
        ("[camera.mount]\nyaw = 3", "camera.mount: object contains unknown field `yaw`; it may have yaw_deg"),
        ("[camera]\ndistortion = ['a']", "camera.distortion"),
        ("[[mavlink.links]]\nurl = 'udpin:127.0.0.1:1'\nfaces = 'sky'", "faces"),
        ("[[mavlink.links]]\nlink = 'x'", "it may have url, faces, adsb"),
        ("[segmenter]\nkind = 'magic'", "segmenter.kind is 'magic'"),
        ("vehicle = 'a/b'", "vehicle is 'a/b'"),
        ("camera.mount.gimbal_device = 2", "camera.mount.gimbal_device is 2: gimbal must be true, or this 0"),
        ("camera.mount.gimbal_device = 256", "camera.mount.gimbal_device is 256"),
        ("camera.device = -1", "camera.device is -1"),
        ("camera.zoom_level = 101", "camera.zoom_level is 101"),
        ("[scenery]\ncorners = 7", "scenery.corners is 7: expected `int` >= 8"),
        ("[scenery]\ncorners = 201", "scenery.corners is 201: expected `int` <= 200"),
        ("[scenery]\nwindow = 3", "scenery.window is 3: expected `int` >= 6"),
        ("[scenery]\nwindow = 61", "scenery.window is 61: expected `int` <= 60"),
        ("[scenery]\nenabled = 'no'", "scenery.enabled is 'no': expected `bool`"),
        ("[scenery]\nkeyframes = 9", "scenery: object contains unknown field `keyframes`; it may have enabled"),
        ("[scenery]\nown_parts = [[0, 0]]", "scenery.own_parts"),
        (
            "[scenery]\nown_parts = [[[0, 0], [9, 9]]]",
            "scenery.own_parts[0] is [[0, 0], [9, 9]]: expected `array` of length >= 3",
        ),
        ("[scenery]\nown_parts = [[[0, 0], [9, 9, 9], [1, 1]]]", "scenery.own_parts"),
        (
            "[scenery]\nown_parts = [[[0, 0], [9, 9], [0, 9]], [[0, 0], [1921, 0], [9, 9]]]",
            "scenery.own_parts[1] has the point [1921, 0]: it must lie in the image of 1920 x 1080 pixels",
        ),
        ("[scenery]\nown_parts = [[[0, 0], [nan, 9], [0, 9]]]", "scenery.own_parts[0] has the point [nan, 9]"),
        ("camera = 3", "camera is 3: expected `object`, got `int`"),
    ],
)
def test_one_line_names_key_value_and_what_is_allowed(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


NOISE = np.random.default_rng(0).integers(0, 256, (600, 1000), dtype=np.uint8)
LANDMARK = "[[landmarks]]\nname = 'mast'\nlat = 47.4\nlon = 8.6\nalt_m = 500\ntemplate = 'mast.png'\n"


def with_templates(folder: Path, text: str) -> Path:
    """A config file beside the pictures that the tests below name."""
    pieces = {"mast": NOISE[:40, :30], "large": NOISE, "small": NOISE[:8, :40], "grey": np.full((40, 40), 99, np.uint8)}
    for name, piece in pieces.items():
        cv2.imwrite(str(folder / f"{name}.png"), piece)
    (folder / "text.png").write_text("no picture")
    (folder / "config.toml").write_text(text)
    return folder / "config.toml"


@pytest.mark.parametrize(
    ("wrong", "right", "says"),
    [
        ("lat = 47.4", "lat = 97.4", "landmarks[0].lat is 97.4: expected `float` <= 90.0"),
        ("lon = 8.6", "lon = -181.0", "landmarks[0].lon is -181.0: expected `float` >= -180.0"),
        (
            "alt_m = 500",
            "alt = 500",
            "landmarks.0: object contains unknown field `alt`; it may have name, lat, lon, alt_m",
        ),
        ("alt_m = 500\n", "", "landmarks[0] is {'name': 'mast'"),
        ("alt_m = 500", "alt_m = 500\nsigma_m = 0", "landmarks[0].sigma_m is 0: expected `float` >= 0.01"),
        ("'mast'", "'a mast'", "landmarks[0].name is 'a mast'"),
        ("mast.png", "none.png", "none.png: cannot be read: No such file or directory; it must be a picture"),
        ("mast.png", "", "is no regular file; it must be a picture that is cut from a frame"),
        ("mast.png", "text.png", "text.png: is no PNG, JPEG, BMP or TIFF; it must be a picture"),
        ("mast.png", "large.png", "1000 x 600 pixels: at most half of the frame's 1920 x 1080: cut it closer"),
        ("mast.png", "small.png", "40 x 8 pixels: at least 9 x 9: cut it wider"),
        ("mast.png", "grey.png", "grey.png': it is all of one grey: cut it where the landmark stands out"),
        ("mast.png", "a" * 300, "landmarks[0].template is"),
        ("[[landmarks]]", LANDMARK + "[[landmarks]]", "landmarks[1].name is 'mast': another one has it"),
    ],
)
def test_a_landmark_that_cannot_be_used_is_refused(tmp_path: Path, wrong: str, right: str, says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(with_templates(tmp_path, LANDMARK.replace(wrong, right, 1)))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_there_are_16_landmarks_at_most(tmp_path: Path) -> None:
    many = [LANDMARK.replace("'mast'", f"'mast{number}'") for number in range(17)]
    assert len(load_config(with_templates(tmp_path, "\n".join(many[:16]))).landmarks) == 16
    with pytest.raises(ConfigError, match=r"landmarks is .*length <= 16"):
        load_config(with_templates(tmp_path, "\n".join(many)))


def test_a_template_lies_beside_the_config_or_where_a_flight_was_recorded(tmp_path: Path) -> None:
    config = with_templates(tmp_path, LANDMARK)
    (landmark,) = load_config(config).landmarks
    assert Path(landmark.template) == tmp_path / "mast.png" and landmark.sigma_enu_m == (2.0, 2.0, 3.0)
    assert template_bytes((landmark,)) == {"mast": (tmp_path / "mast.png").read_bytes()}
    (tmp_path / "landmarks").mkdir()
    (tmp_path / "mast.png").rename(tmp_path / "landmarks" / "mast.png")
    (recorded,) = load_config(config).landmarks
    assert Path(recorded.template) == tmp_path / "landmarks" / "mast.png"
    assert template_bytes((msgspec.structs.replace(landmark, template="/nowhere"),)) == {}
