"""What a config may say of a command as the camera, and the line for what it may not."""

from pathlib import Path

import pytest

from service.config.load import load_config
from service.config.sections import ConfigError

GOOD = '[camera.source]\nkind = "command"\ncommand = ["gst-launch-1.0", "-q"]\n'


def loaded(tmp_path: Path, text: str) -> object:
    (tmp_path / "config.toml").write_text(text)
    return load_config(tmp_path / "config.toml").camera.source


@pytest.mark.parametrize(
    "more",
    ["", 'format = "mjpeg"\ndecode_width = 0', 'format = "nv12"', 'format = "bgr"\nwidth = 960\nheight = 540']
    + [f'times = "{clock}"' for clock in ("arrival", "monotonic", "boottime", "unix", "relative")],
)
def test_what_is_taken(tmp_path: Path, more: str) -> None:
    source = loaded(tmp_path, GOOD + more)
    assert source.command == ("gst-launch-1.0", "-q") and source.is_live  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('kind = "command"', "camera.source.command names no program: it must be a list, the program and each of its"),
        ('kind = "command"\ncommand = [""]', "camera.source.command names no program"),
        (
            'kind = "command"\ncommand = "gst-launch-1.0 -q"',
            "camera.source.command is 'gst-launch-1.0 -q': expected `ar",
        ),
        ('kind = "command"\ncommand = ["a", 3]', "camera.source.command[1] is 3: expected `str`"),
        (GOOD + 'path = "/dev/video0"', "camera.source.path is '/dev/video0': kind = 'command' takes command alone"),
        (GOOD + 'format = "yuyv"', "camera.source.format is 'yuyv': invalid enum value"),
        (GOOD + 'format = "bgr"\nwidth = 960', "camera.source.width, height: give both, or none"),
        (GOOD + "width = 960\nheight = 540", "camera.source.width is 960: format = 'y4m' says its own size"),
        (
            GOOD + 'format = "bgr"\nwidth = 1280\nheight = 720',
            "camera.source.width, height are 1280 x 720: they must be camera.width, camera.height, 1920 x 1080, or a",
        ),
        (GOOD + 'format = "i420"\nwidth = 640\nheight = 360', ""),
        (GOOD + 'format = "nv12"\nwidth = 240\nheight = 135', "240 x 135: format = 'nv12' needs even numbers"),
        (GOOD + 'times = "gps"', "camera.source.times is 'gps': invalid enum value"),
        (GOOD.replace('"command"', '"rtsp"') + 'path = "rtsp://h/x"', "command is given: it is for kind = 'command'"),
        ('kind = "v4l2"\npath = "/dev/video0"\ntimes = "unix"', "camera.source.times is given: it is for kind = 'com"),
        ('kind = "v4l2"', "camera.source.path is empty: kind = 'v4l2' needs one"),
    ],
)
def test_one_line_for_what_is_not(tmp_path: Path, text: str, says: str) -> None:
    text = text if text.startswith("[") else f"[camera.source]\n{text}"
    if not says:
        loaded(tmp_path, text)
        return
    with pytest.raises(ConfigError) as caught:
        loaded(tmp_path, text)
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_a_password_in_the_command_is_in_no_line(tmp_path: Path) -> None:
    text = GOOD.replace('"-q"', '"-i", "rtsp://a:S3cret@h/x"').replace('"command"\n', '"rtsp"\n') + 'path = "x"'
    with pytest.raises(ConfigError) as caught:
        loaded(tmp_path, text)
    assert "S3cret" not in str(caught.value)
