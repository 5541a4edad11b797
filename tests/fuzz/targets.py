"""What is fuzzed: each target takes one input and raises for what must not happen; refusing the input is right."""

import hashlib
import random
import struct
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from distloc.geometry.camera import Camera
from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.config.endpoint import parse_endpoint
from service.config.load import load_config
from service.config.sections import (
    CameraConfig,
    Config,
    ConfigError,
    MavlinkConfig,
    MountConfig,
    PreprocessingConfig,
)
from service.localise.continuity import Refusal
from service.localise.track_store import Kept
from service.localise.track_store import decode as decode_state
from service.localise.track_store import encode as encode_state
from service.mavlink.framer import LONGEST_FRAME, Framer, decode
from service.mavlink.signing import Keyring, Signed
from service.publish.mavlink import MavlinkPublisher
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording, RecordingError
from service.recordings.tlog import TlogReader
from service.segmenters.model_card import model_card
from tests.fuzz.mutations import changed_value, mutated, stream
from tests.support.kept_samples import kept
from tests.support.places import ROOT

FLIGHT = ROOT / "tests" / "replay" / "copter_nominal_cut"
README_CONFIG = (ROOT / "README.md").read_bytes().partition(b"```toml\n")[2].partition(b"```")[0]
CAMERA = Camera(1920, 1080, 1200.0, 1200.0, 960.0, 540.0)
MS = 1_000_000
TLOG_BYTES = 4_000


class Link:
    """The way of bytes from a socket: framer, signing, autopilot, commands; one for all inputs, as in the service."""

    def __init__(self) -> None:
        self.framer = Framer()
        self.autopilot = Autopilot(MavlinkConfig(), MountConfig(gimbal=True), camera=CameraConfig())
        self.publisher = MavlinkPublisher(CAMERA)
        self.publisher.set_system(1)
        self.signing = Signed(Keyring(bytes(range(32)), lambda: 0), 0)
        self._now_ns = 10**12

    def feed(self, rng: random.Random, data: bytes) -> int | None:
        """Bytes in one or two pieces, then what the service asks; the count of frames, None for none."""
        cut = rng.randrange(len(data) + 1)
        frames = self.framer.feed(data[:cut]) + self.framer.feed(data[cut:])
        assert len(self.framer._rest) <= LONGEST_FRAME
        for frame in frames:
            self._now_ns += 5 * MS
            if frame.raw[0] == 0xFD and frame.raw[2] & 1:
                assert not self.signing.accepts(frame) or frame.message_id == 109
            self.autopilot.receive(frame, self._now_ns)
            if frame.message_id in (75, 76):
                replies = self.publisher.handle(decode(frame), self._now_ns)
                assert sum(len(Framer().feed(reply)) for reply in replies) == len(replies)
        pose = self.autopilot.camera_pose(self._now_ns - 300 * MS, self._now_ns)
        assert pose is None or isinstance(pose, RejectReason) or is_sound(pose)
        for request in self.autopilot.due(self._now_ns):
            assert Framer().feed(request)
        return len(frames) or None


def is_sound(pose: CameraPose) -> bool:
    """Whether all its numbers are finite and its rotation is one."""
    R = pose.R_cam_from_enu
    return bool(np.isfinite(pose.position_enu_m).all() and np.allclose(R @ R.T, np.eye(3), atol=1e-6))


def harmed_config(rng: random.Random) -> bytes:
    """README's example, changed."""
    text = changed_value(rng, README_CONFIG) if rng.random() < 0.7 else README_CONFIG
    return mutated(rng, text) if rng.random() < 0.4 else text


def config(folder: Path, data: bytes) -> Config | None:
    """Load it, and make what the service makes of it; None where it was refused in one line."""
    path = folder / "config.toml"
    path.write_bytes(data)
    try:
        made = load_config(path)
    except ConfigError as error:
        assert "\n" not in str(error) and len(str(error)) < 2000, str(error)[:300]
        return None
    for link in made.mavlink.links:
        parse_endpoint(link.url)
    camera = made.camera.camera()
    Autopilot(made.mavlink, made.camera.mount, pose_errors=made.pose_errors.pose_errors(), camera=made.camera)
    MavlinkPublisher(camera, made.mavlink.command_systems)
    assert (
        np.isfinite(made.camera.mount.R_body_from_mount).all() and np.isfinite(made.camera.mount.lever_arm_body_m).all()
    )
    return made


class Flight:
    """A real recording's files, of which each input harms one."""

    def __init__(self) -> None:
        self.files = {name: (FLIGHT / name).read_bytes() for name in ("frames.csv", "truth.json", "telemetry.tlog")}
        self.files["telemetry.tlog"] = self.files["telemetry.tlog"][:TLOG_BYTES]
        self.files["frames.csv"] = b"\n".join(self.files["frames.csv"].split(b"\n")[:40])

    def harmed(self, rng: random.Random) -> dict[str, bytes]:
        """The files, one of them changed; a log may have whole frames of any kind put in."""
        name = rng.choice(list(self.files))
        data = mutated(rng, self.files[name])
        if name == "telemetry.tlog" and rng.random() < 0.5:
            at = rng.randrange(len(data) + 1)
            data = data[:at] + data[at : at + 8] + stream(rng) + data[at:]
        return {**self.files, name: data}


def recording(folder: Path, files: dict[str, bytes]) -> int | None:
    """Read it all as the replay does; how many poses it gave, None where it was refused in one line."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
    try:
        held = Recording(folder)
        frames = held.frames()
        assert frames == sorted(frames, key=lambda row: row[0])
        for _, name in frames[:3]:
            held.load_image(name)
        assert sum(len(raw) for _, raw in TlogReader(held.tlog_path)) <= len(files["telemetry.tlog"])
        return sum(is_sound(pose) for _, pose in PosedFrames(held, Config()).pairs(lambda stamp_ns: None))
    except RecordingError as error:
        assert "\n" not in str(error), str(error)
        return None


CARD = {
    "input_width": "64", "input_height": "32", "layout": "NCHW", "colour": "RGB", "scale": "0.00392156862745098",
    "mean": "0.4,0.4,0.4", "std": "1", "output": "logits", "classes": "background,smoke", "smoke_class": "smoke",
    "threshold": "0.5", "resize": "budget", "multiple": "32", "boxes": "yolov8", "version": "1",
}  # fmt: skip


EXPORTED = {
    "task": "detect", "imgsz": "[320, 640]", "names": "{0: 'smoke', 1: \"fire's\"}", "end2end": "False",
    "args": "{'batch': 1, 'nms': True}",
}  # fmt: skip


def harmed_card(rng: random.Random) -> dict[str, str]:
    """A model's metadata, ours or YOLO's exporter's, with values and keys harmed."""
    card = {f"distloc.{key}": value for key, value in CARD.items()} if rng.random() < 0.7 else dict(EXPORTED)
    for _ in range(rng.randint(1, 3)):
        key = rng.choice(list(card))
        text = mutated(rng, card.pop(key).encode()).decode(errors="replace")
        card[mutated(rng, key.encode()).decode(errors="replace") if rng.random() < 0.1 else key] = text
    return card


def card(metadata: dict[str, str]) -> bool:
    """Whether the card was taken; it is then fit to run, else it was refused in one line."""
    try:
        made = model_card(Path("model.onnx"), metadata, PreprocessingConfig())
    except ConfigError as error:
        assert "\n" not in str(error) and len(str(error)) < 2000, str(error)[:300]
        return False
    assert made.width >= 8 and made.height >= 8 and 0 < made.threshold < 1 and np.isfinite(made.scale)
    assert made.mean.shape == made.std.shape == (3,) and (made.std != 0).all() and made.classes[made.smoke_index]
    return True


_DIGEST_BYTES = 32
_FLOATS = (float("nan"), float("inf"), -1.0, 0.0, 1e308, -1e308, 5e-324, 90.0, 181.0)
_ODD_VALUES = (
    *(None, True, -1, 0, 2**31, 2**63, 2**64 - 1, -(2**63), "", "x", b"", b"x" * 9, [], {}, [[]], *_FLOATS),
    *([dtype, [3], bytes(24)] for dtype in ("<f8", "<f4", "<i8", "|b1", ">f8", "|O", "<M8[s]", "f8,f8", [], None, 8)),
    *(["<f8", shape, bytes(16)] for shape in ([-1], [2**31, 2**33], [2**64 - 1], [2.0], [True, 2], "2", [[2]], [])),
    *(["<f8", [2]], ["<f8", [2], "x" * 16], ["<f8", [1] * 70, bytes(8)], ["<f4", [0, 3], b""]),
)  # fmt: skip


class State:
    """A file of kept targets, of which each input harms the bytes or the values."""

    def __init__(self) -> None:
        self.data = encode_state(kept())

    def harmed(self, rng: random.Random) -> bytes:
        """The file changed: as a disk might, or with a checksum that is right again."""
        what, payload = rng.randrange(4), self.data[_DIGEST_BYTES:]
        if what == 0:
            return mutated(rng, self.data)
        return _with_checksum(mutated(rng, payload) if what == 1 else _with_changed_values(rng, payload))


def _with_checksum(payload: bytes) -> bytes:
    return hashlib.sha256(payload).digest() + payload


def _with_changed_values(rng: random.Random, payload: bytes) -> bytes:
    content = msgspec.msgpack.decode(payload)
    for _ in range(rng.randint(1, 3)):
        places = list(_places(content))
        holder, key = rng.choice(places)
        value, what = holder[key], rng.randrange(4)
        if what == 0:
            other, name = rng.choice(places)
            holder[key] = deepcopy(other[name])
        elif what == 1 and isinstance(holder, dict):
            del holder[key]
        elif isinstance(value, bytes) and len(value) >= 8:
            at = 8 * rng.randrange(len(value) // 8)
            number = struct.pack("<d", rng.choice(_FLOATS))
            holder[key] = value[:at] + number + value[at + 8 :] if rng.random() < 0.5 else mutated(rng, value)
        else:
            holder[key] = deepcopy(rng.choice(_ODD_VALUES))
    return msgspec.msgpack.encode(content)


def _places(content: Any) -> Iterator[tuple[Any, Any]]:
    """Each value within maps and lists, as its holder and key."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield content, key
        yield from _places(value)


def state(data: bytes) -> Kept | None:
    """What the file holds, sound in all its numbers; None where it was refused."""
    found = decode_state(data)
    if isinstance(found, Refusal):
        assert found in (Refusal.DAMAGED, Refusal.OTHER_VERSION)
        return None
    assert np.isfinite([found.moment.monotonic_s, *found.origin, *found.camera_enu_m]).all()
    for track in found.localizer.tracks:
        cloud = track.filter
        assert cloud.positions_m.dtype == cloud.nuisances.dtype == np.float32
        assert np.isfinite(cloud.positions_m).all() and np.isfinite(cloud.nuisances).all()
        assert cloud.positions_m.shape[1] == cloud.nuisances.shape[1] > 0 and track.life.id < found.localizer.next_id
    return found
