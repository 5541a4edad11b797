"""Replay a recording through the code that flies: the same bytes in, the same reports out, for the same seed."""

import logging
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from distloc.types import CameraPose
from service.common.files import whole_file, write_whole
from service.config.sections import Config
from service.localise.mount_watch import mount_line
from service.localise.pipeline import FramePipeline
from service.publish.explained import report_from_explanation
from service.publish.wire import Report, encode, geojson_collection, report_from_scenery, report_from_target
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording
from service.recordings.replay_words import Outcome
from service.recordings.score import Score, ScoreKeeper
from service.segmenters.segment import RecordedSegmenter, make_segmenter

log = logging.getLogger(__name__)


class Replay:
    """Runs the localise stage over a recording's frames and keeps what the results need."""

    def __init__(self, recording: Recording, config: Config, seed: int | None = None) -> None:
        self._recording = recording
        self._config = config
        self._posed = PosedFrames(recording, config)
        segmenter = make_segmenter(config.segmenter, config.camera.camera(), recording.tlog_path.parent)
        self.pipeline = FramePipeline(config, segmenter, self._posed.gate, seed)
        self.scores = ScoreKeeper()
        self.last: dict[int, Report] = {}

    def run(self, on_report: Callable[[bytes], None], on_stamp: Callable[[int], None]) -> None:
        """Run to the log's end; `on_report` gets each report's JSON, `on_stamp` the log's time in ns."""
        for frame, pose in self._posed.pairs(on_stamp):
            targets = self.pipeline.located(self.pipeline.localise(frame, pose))
            self.scores.add(targets, pose)
            for target in targets:
                report = report_from_target(target, self._config.vehicle)
                self.last[target.estimate.id] = report
                on_report(encode(report))
        for fault in self._posed.autopilot.payload_faults(self._posed.stamp_ns):
            log.warning("at the log's end %s", fault)

    def status(self) -> dict[str, Any]:
        """Counters, reject reasons and the first and last pose."""
        posed, stage = self._posed, self.pipeline.stage
        return {
            "schema": "distloc/replay/1",
            "telemetry": {
                "frames": posed.reader.frames,
                "dropped_bytes": posed.reader.dropped_bytes,
                "bad_crc": posed.framer.bad_crc,
                "unknown_ids": posed.framer.unknown_ids,
                "wild_stamps": posed.reader.wild,
                "clock_steps": max(0, len(posed.reader.spans) - 1),
            },
            "autopilot": posed.autopilot.counters(),
            "frames": {
                "localised": stage.frames,
                "rejected": {str(reason): count for reason, count in sorted(self.pipeline.rejects.items())},
                "dropped_from_recording": dict(sorted(self._recording.dropped.items())),
            },
            "segmenter": stage.segmenter.name,
            "ground": stage.ground.counters(),
            "scenery": msgspec.to_builtins(report_from_scenery(stage.scenery.state)),
            "explain": msgspec.to_builtins(report_from_explanation(stage.explanation)),
            "targets": len(self.last),
            "poses_at_1_hz": dict(sorted(posed.probes.items())),
            "first_pose": self._described(posed.first_pose),
            "last_pose": self._described(posed.last_pose),
        }

    def outcome(self) -> Outcome:
        """What became of the frames and whether poses came, for one line."""
        posed, segmenter = self._posed, self.pipeline.stage.segmenter
        return Outcome(
            localised=self.pipeline.stage.frames,
            rejects=Counter({str(reason): count for reason, count in self.pipeline.rejects.items()}),
            bad_rows=self._recording.dropped,
            seconds=posed.probes,
            has_table=self._recording.has_table,
            is_bare=self._recording.is_bare,
            wild=posed.reader.wild,
            steps=max(0, len(posed.reader.spans) - 1),
            faint_masks=segmenter.faint if isinstance(segmenter, RecordedSegmenter) else 0,
            has_unused_masks=self._recording.masks_folder is not None and not isinstance(segmenter, RecordedSegmenter),
            mount=mount_line(self.pipeline.stage.scenery.state.mount, self._config.camera.mount),
        )

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
) -> tuple[Score | None, Outcome]:
    """Replay into a folder: reports.jsonl, targets.geojson, status.json and, with truth, score.json."""
    run = Replay(recording, config, seed)
    pace = _Pace() if realtime else None

    def on_stamp(stamp_ns: int) -> None:
        on_progress(stamp_ns)
        if pace:
            pace.wait(stamp_ns)

    with tempfile.TemporaryFile() as reports:  # as long as the flight; nothing is in `out` before the end
        run.run(lambda line: reports.writelines((line, b"\n")), on_stamp)
        reports.seek(0)
        out.mkdir(parents=True, exist_ok=True)
        with whole_file(out / "reports.jsonl") as file:
            shutil.copyfileobj(reports, file)
    score = run.score()
    write_whole(out / "targets.geojson", geojson_collection(list(run.last.values())))
    write_whole(out / "status.json", msgspec.json.format(msgspec.json.encode(run.status()), indent=1) + b"\n")
    if score is not None:
        write_whole(out / "score.json", msgspec.json.format(msgspec.json.encode(score), indent=1) + b"\n")
    return score, run.outcome()


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
