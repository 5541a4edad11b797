"""Reads the config file and refuses keys that contradict each other; commands and the app call it."""

from collections.abc import Iterable
from ipaddress import ip_address
from pathlib import Path

import msgspec

from distloc.backports import tomllib
from service.common.files import FileRefusedError, check_file
from service.config.endpoint import parse_endpoint
from service.config.explained import explained
from service.config.landmarks import beside, check_landmarks
from service.config.section import ConfigError
from service.config.sections import Config
from service.config.tak_section import check_tak

_LONGEST_PATH, _LONGEST_NAME = 4000, 255  # bytes, as Linux has them
_MOST_CONFIG_BYTES = 1_000_000


def load_config(path: Path) -> Config:
    """The configuration in a TOML file; ConfigError in one line for anything wrong with it."""
    try:
        check_file(path, most_bytes=_MOST_CONFIG_BYTES)
        text = path.read_text(encoding="utf-8-sig")
    except FileRefusedError as error:
        raise ConfigError(str(error)) from error
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise ConfigError(f"{path}: not TOML that can be read: nested too deeply") from error
    except ValueError as error:  # TOMLDecodeError, and Python's own for an integer of thousands of digits
        raise ConfigError(f"{path}: not TOML: {error!s:.200}") from error
    if (key := _key_with_nul(content)) is not None:
        raise ConfigError(f"{path}: {key} holds a NUL character: no text of the config may")
    try:
        config = msgspec.convert(content, Config)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {explained(error, content, Config)}") from error
    if config.landmarks:
        config = msgspec.structs.replace(config, landmarks=beside(config.landmarks, path.parent))
    check(config)
    return config


def _key_with_nul(value: object, key: str = "") -> str | None:
    """The first key whose text has a NUL, which no path, name or address can have."""
    if isinstance(value, str):
        return (key or "the file") if "\0" in value else None
    pairs: Iterable[tuple[object, object]] = ()
    if isinstance(value, dict):
        pairs = value.items()
    elif isinstance(value, list):
        pairs = ((key, one) for one in value)
    found = (_key_with_nul(one, f"{key}.{name}".strip(".") if isinstance(value, dict) else key) for name, one in pairs)
    return next((one for one in found if one is not None), None)


def _paths(config: Config) -> Iterable[tuple[str, str]]:
    """The keys that name a file, a folder or a device, and what they have."""
    if config.camera.source.kind != "rtsp":
        yield "camera.source.path", config.camera.source.path
    yield "ground.path", config.ground.path
    yield "segmenter.model", config.segmenter.model
    yield "recorder.folder", config.recorder.folder
    yield "state.dir", config.state.dir or ""
    yield from ((f"landmarks[{number}].template", one.template) for number, one in enumerate(config.landmarks))


def check(config: Config) -> None:
    """Raise ConfigError where keys contradict each other."""
    config.camera.camera()
    check_tak(config.tak)
    for key, text in _paths(config):
        if len(text) > _LONGEST_PATH or any(len(part.encode()) > _LONGEST_NAME for part in text.split("/")):
            raise ConfigError(
                f"{key} is {text[:40]!r} and so on: longer than a path may be ({_LONGEST_PATH} characters)"
            )
    mount = config.camera.mount
    if mount.gimbal_device and not mount.gimbal:
        raise ConfigError(f"camera.mount.gimbal_device is {mount.gimbal_device}: gimbal must be true, or this 0")
    low, high = config.localizer.range_m
    if not 0 < low < high < 1e6:
        raise ConfigError(f"localizer.range_m is [{low}, {high}]: it must be two rising distances in metres above 0")
    _check_own_parts(config)
    check_landmarks(config.landmarks, config.camera.width, config.camera.height)
    if config.segmenter.tiles == 1:
        raise ConfigError("segmenter.tiles is 1: it must be 0 (none) or at least 2 rows and columns")
    config.camera.source.check(config.camera.width, config.camera.height)
    if config.ground.kind == "dem" and not (config.ground.path and Path(config.ground.path).exists()):
        raise ConfigError(
            f"ground.path is '{config.ground.path}': kind = 'dem' needs an .hgt file, a GeoTIFF or a folder of them"
        )
    if config.state.dir and Path(config.state.dir).exists() and not Path(config.state.dir).is_dir():
        raise ConfigError(f"state.dir is '{config.state.dir}': it must be a folder, or a name for a new one")
    _check_klv(config.klv.url)
    for link in config.mavlink.links:
        try:
            parse_endpoint(link.url)
        except ValueError as error:
            raise ConfigError(f"mavlink.links: {error}") from error
        if link.adsb and link.faces != "ground":
            raise ConfigError(
                f"mavlink.links: adsb = true on {link.url} needs faces = 'ground': an autopilot may fly by it"
            )


def _check_klv(url: str) -> None:
    """An address, no name: to ask for one could hold up what flies."""
    if not url:
        return
    try:
        endpoint = parse_endpoint(url)
    except ValueError as error:
        raise ConfigError(f"klv.url: {error}") from error
    try:
        ip_address(endpoint.host)
    except ValueError as error:
        raise ConfigError(
            f"klv.url is '{url}': {endpoint.host!r} must be an address, as in udpout:239.1.2.3:5004"
        ) from error
    if endpoint.kind != "udpout":
        raise ConfigError(f"klv.url is '{url}': must be udpout:ADDRESS:PORT")


def _check_own_parts(config: Config) -> None:
    width, height = config.camera.width, config.camera.height
    for number, polygon in enumerate(config.scenery.own_parts):
        for u, v in polygon:
            if not (0.0 <= u <= width and 0.0 <= v <= height):
                raise ConfigError(
                    f"scenery.own_parts[{number}] has the point [{u:g}, {v:g}]: it must lie in the image of "
                    f"{width} x {height} pixels"
                )
