"""Secrets are in no line, log or recorded config."""

import logging
from pathlib import Path

import pytest

from service.commands.check.finding import warn
from service.common.redact import redacted
from service.common.shown import ShownFormatter
from service.config.load import load_config
from service.config.sections import Config, ConfigError, RecorderConfig, ZenohConfig
from service.flight.app import App


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("rtsp://admin:S3cret@192.0.2.1:554/x", "rtsp://admin:***@192.0.2.1:554/x"),
        ("rtsp://:S3cret@h/x", "rtsp://:***@h/x"),
        ("rtsp://a:S3:c@r/e?t@h/x", "rtsp://a:***@h/x"),
        ("mqtts://u:S3cret@h:8883", "mqtts://u:***@h:8883"),
        ("tls/u:S3cret@h:7447", "tls/u:***@h:7447"),
        ("http://h/x?user=a&password=S3cret&n=1", "http://h/x?user=a&password=***&n=1"),
        ("https://h/x?access_token=S3cret#k", "https://h/x?access_token=***#k"),
        ("tcp/h:7447#user=a;password=S3cret", "tcp/h:7447#user=a;password=***"),
        ("http://h/live?key=S3cret&n=1", "http://h/live?key=***&n=1"),
        ("tls/h:7447#connect_private_key_base64=S3cret", "tls/h:7447#connect_private_key_base64=***"),
        ("http://h/?X-Amz-Signature=S3cret", "http://h/?X-Amz-Signature=***"),
        ('command = ["gst-launch-1.0", "user-pw=S3cret", "x"]', 'command = ["gst-launch-1.0", "user-pw=***", "x"]'),
        ("curl --token=S3cret -q", "curl --token=*** -q"),
        ('path = "rtsp://a:S3cret@h/x"\nlatency_ms = 4', 'path = "rtsp://a:***@h/x"\nlatency_ms = 4'),
    ],
)
def test_secrets_of_addresses(text: str, shown: str) -> None:
    assert redacted(text) == shown == redacted(shown)


@pytest.mark.parametrize(
    "text",
    [
        "udpin:127.0.0.1:14550",
        "rtsp://h:554/x?channel=1",
        "tcp/0.0.0.0:7447",
        'password_file = "credential:zenoh"',
        "11:07:04 INFO a@b",
        "rtsp://admin@h/x",
        "serial:/dev/ttyTHS1:921600",
    ],
)
def test_what_is_no_secret_stays(text: str) -> None:
    assert redacted(text) == text


def test_long_text_costs_little() -> None:
    for text in ("a" * 100_000, "a:" * 50_000, "a.b-" * 25_000, "?token" * 20_000):
        assert redacted(text) == text  # quadratic would be minutes


def test_the_log_hides_them_in_tracebacks_too() -> None:
    try:
        raise OSError("rtsp://a:S3cret@h/x")
    except OSError as error:
        record = logging.LogRecord("x", 30, "x", 1, "lost %s", ("http://b:S3cret@h",), (OSError, error, None))
    line = ShownFormatter("%(message)s").format(record)
    assert "S3cret" not in line and "http://b:***@h" in line and "rtsp://a:***@h/x" in line


def test_the_doctor_hides_them() -> None:
    assert str(warn("camera", "rtsp://a:S3cret@h/x is away", "see rtsp://a:S3cret@h")).count("***") == 2


@pytest.mark.parametrize(
    "text",
    [
        '[camera]\nsource = "rtsp://admin:S3cret@h/x"',
        '[camera.source]\nkind = "rtsp://admin:S3cret@h/x"',
        '[[mavlink.links]]\nurl = "rtsp://admin:S3cret@h/x"',
        f'[[mavlink.links]]\nurl = "rtsp://admin:S3cret@h/{"x" * 400}"',
        '[[mavlink.links]]\nurl = "tcp://admin:S3cret@h:80x"',
        f'[camera]\nsource = "rtsp://{"u" * 40}:S3cret@h/x"',
    ],
)
def test_no_error_of_the_config_tells_them(tmp_path: Path, text: str) -> None:
    (tmp_path / "config.toml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config(tmp_path / "config.toml")
    assert "S3c" not in str(caught.value)


def test_the_recorded_config_has_none() -> None:
    config = Config(zenoh=ZenohConfig(enabled=False), recorder=RecorderConfig())
    assert App(config, 'path = "rtsp://a:S3cret@h/x"')._config_text == 'path = "rtsp://a:***@h/x"'
