from pathlib import Path

import pytest

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
