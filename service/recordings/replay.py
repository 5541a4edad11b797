"""Replay a recording through the code that flies: the same bytes in, the same reports out, for the same seed."""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.camera.blind import has_picture
from service.common.files import write_whole
from service.common.messages import Frame
from service.config.sections import Config
from service.localise.stage import LocaliseStage, Locator
from service.mavlink.framer import Framer
from service.publish.wire import Report, encode, geojson_collection, report_from_target
from service.recordings.recording import Recording, RecordingError
from service.recordings.score import Score, ScoreKeeper
from service.recordings.tlog import TlogReader
from service.segmenters.segment import make_segmenter

_FLUSH_NS = 2_000_000_000  # past the longest wait for a pose
_PROBE_NS = 1_000_000_000  # how often the pose is asked for where there may be no frame
_PROBE_AGE_NS = 300_000_000  # a pose so old has had its later sample


class PosedFrames:
    """Merges a recording's log and frames in the order of their stamps, and finds each frame's pose; runs once.

    The replay and the study of a recording read it. `rejects` counts the frames without a pose or a picture by reason.
    """

    def __init__(self, recording: Recording, config: Config) -> None:
        self.autopilot = Autopilot(
            config.mavlink, config.camera.mount, replay=True, pose_errors=config.pose_errors.pose_errors()
        )
        self.reader = TlogReader(recording.tlog_path)
        self.framer = Framer()
        self.rejects: Counter[RejectReason] = Counter()
        self.first_pose: CameraPose | None = None
        self.last_pose: CameraPose | None = None
        self.probes: Counter[str] = Counter()
        self._recording = recording
        self._next_probe_ns = 0
        self._waiting: deque[Frame] = deque()

    def pairs(self, on_stamp: Callable[[int], None]) -> Iterator[tuple[Frame, CameraPose]]:
        """Each frame with a picture and a pose, to the log's end; `autopilot` is then as it was when it was taken.

        `on_stamp` gets the log's time in ns. Raises RecordingError where the log holds no MAVLink frame.
        """
        frames = deque(sorted(self._recording.frames()))
        stamp_ns = 0
        for stamp_us, raw in self.reader:
            stamp_ns = stamp_us * 1000
            on_stamp(stamp_ns)
            while frames and frames[0][0] <= stamp_us:
                self._load(*frames.popleft())
            for mav_frame in self.framer.feed(raw):
                self.autopilot.receive(mav_frame, stamp_ns)
            yield from self._take_waiting(stamp_ns)
            self._probe(stamp_ns)
        if not self.reader.frames:
            raise RecordingError(f"{self._recording.tlog_path}: holds no MAVLink frame: is it a telemetry log?")
        for stamp_us, name in frames:
            self._load(stamp_us, name)
        yield from self._take_waiting(max(stamp_ns, self._waiting[-1].stamp_ns if self._waiting else 0) + _FLUSH_NS)

    def _load(self, stamp_us: int, name: str) -> None:
        frame = Frame(stamp_us * 1000, name, self._recording.load_image(name))
        if has_picture(frame):
            self._waiting.append(frame)
        else:
            self.rejects[RejectReason.BLIND_FRAME] += 1

    def _probe(self, now_ns: int) -> None:
        """Once a second, count whether there is a pose or why not."""
        if now_ns < self._next_probe_ns:
            return
        self._next_probe_ns = now_ns + _PROBE_NS
        pose = self.autopilot.camera_pose(now_ns - _PROBE_AGE_NS, now_ns)
        self.probes["pose" if isinstance(pose, CameraPose) else str(pose or RejectReason.NO_CLOCK)] += 1
        if isinstance(pose, CameraPose):
            self.first_pose = self.first_pose or pose
            self.last_pose = pose

    def _take_waiting(self, now_ns: int) -> Iterator[tuple[Frame, CameraPose]]:
        while self._waiting:
            frame = self._waiting[0]
            pose = self.autopilot.camera_pose(frame.stamp_ns, now_ns)
            if pose is None:
                return
            self._waiting.popleft()
            if isinstance(pose, RejectReason):
                self.rejects[pose] += 1
            else:
                yield frame, pose


class Replay:
    """Runs the localise stage over a recording's frames and keeps what the results need."""

    def __init__(self, recording: Recording, config: Config, seed: int | None = None) -> None:
        self._recording = recording
        self._config = config
        self._posed = PosedFrames(recording, config)
        segmenter = make_segmenter(config.segmenter, config.camera.camera(), recording.tlog_path.parent)
        self.stage = LocaliseStage(config, segmenter, self._posed.autopilot, seed)
        self.scores = ScoreKeeper()
        self.last: dict[int, Report] = {}
        self._locator = Locator(self._posed.autopilot)

    def run(self, on_report: Callable[[bytes], None], on_stamp: Callable[[int], None]) -> None:
        """Run to the log's end; `on_report` gets each report's JSON, `on_stamp` the log's time in ns."""
        for frame, pose in self._posed.pairs(on_stamp):
            targets = self._locator.locate(self.stage.process(frame, pose).estimates, frame.stamp_ns)
            self.scores.add(targets, pose)
            for target in targets:
                report = report_from_target(target, self._config.vehicle)
                self.last[target.estimate.id] = report
                on_report(encode(report))

    def status(self) -> dict[str, Any]:
        """Counters, reject reasons and the first and last pose."""
        posed = self._posed
        rejects = posed.rejects + self.stage.rejects
        return {
            "schema": "distloc/replay/1",
            "telemetry": {
                "frames": posed.reader.frames,
                "dropped_bytes": posed.reader.dropped_bytes,
                "bad_crc": posed.framer.bad_crc,
                "unknown_ids": posed.framer.unknown_ids,
            },
            "autopilot": posed.autopilot.counters(),
            "frames": {
                "localised": self.stage.frames,
                "rejected": {str(reason): count for reason, count in sorted(rejects.items())},
                "dropped_from_recording": dict(sorted(self._recording.dropped.items())),
            },
            "segmenter": self.stage.segmenter.name,
            "ground": self.stage.ground.counters(),
            "targets": len(self.last),
            "poses_at_1_hz": dict(sorted(posed.probes.items())),
            "first_pose": self._described(posed.first_pose),
            "last_pose": self._described(posed.last_pose),
        }

    def score(self) -> Score | None:
        """The score against the recording's truth, if it has one."""
        truth = self._recording.truth
        return None if truth is None else self.scores.score(truth, self._posed.autopilot.frame_enu)

    def _described(self, pose: CameraPose | None) -> dict[str, Any] | None:
        frame_enu = self._posed.autopilot.frame_enu
        if pose is None or frame_enu is None:
            return None
        lat, lon, alt = frame_enu.geodetic_from_enu(pose.position_enu_m)
        place = {"lat": round(lat, 8), "lon": round(lon, 8), "alt_msl_m": round(alt, 3)}
        return {"stamp_s": round(pose.stamp_s, 6), **place}


def replay(
    recording: Recording,
    config: Config,
    out: Path,
    *,
    seed: int | None = None,
    realtime: bool = False,
    on_progress: Callable[[int], None] = lambda stamp_ns: None,
) -> Score | None:
    """Replay into a folder: reports.jsonl, targets.geojson, status.json and, with truth, score.json."""
    run = Replay(recording, config, seed)
    reports: list[bytes] = []
    pace = _Pace() if realtime else None

    def on_stamp(stamp_ns: int) -> None:
        on_progress(stamp_ns)
        if pace:
            pace.wait(stamp_ns)

    run.run(reports.append, on_stamp)
    out.mkdir(parents=True, exist_ok=True)
    score = run.score()
    write_whole(out / "reports.jsonl", b"".join(line + b"\n" for line in reports))
    write_whole(out / "targets.geojson", geojson_collection(list(run.last.values())))
    write_whole(out / "status.json", msgspec.json.format(msgspec.json.encode(run.status()), indent=1) + b"\n")
    if score is not None:
        write_whole(out / "score.json", msgspec.json.format(msgspec.json.encode(score), indent=1) + b"\n")
    return score


class _Pace:
    """Holds a replay to the log's own speed."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None

    def wait(self, stamp_ns: int) -> None:
        now_ns = time.monotonic_ns()
        if self._offset_ns is None:
            self._offset_ns = now_ns - stamp_ns
        ahead_ns = stamp_ns + self._offset_ns - now_ns
        if ahead_ns > 0:
            time.sleep(ahead_ns * 1e-9)
