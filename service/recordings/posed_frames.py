"""A recording's frames with their poses, in the order of time; replay, calibration and study read it."""

import logging
from collections import Counter, deque
from collections.abc import Callable, Iterator

from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.common.files import FileRefusedError
from service.common.messages import Frame
from service.config.doubts import told_errors
from service.config.sections import Config
from service.localise.pipeline import FrameGate
from service.mavlink.framer import Framer
from service.recordings.log_clock import Span, even_rows
from service.recordings.recording import Recording, RecordingError
from service.recordings.tlog import TlogReader

log = logging.getLogger(__name__)

_FLUSH_NS = 2_000_000_000  # past the longest wait for a pose
_PROBE_NS = 1_000_000_000  # how often the pose is asked for where there may be no frame
_PROBE_AGE_NS = 300_000_000  # a pose so old has had its later sample


class PosedFrames:
    """Merges a recording's log and frames in the order of their stamps, and finds each frame's pose; runs once.

    The replay, the calibration and the study of a recording read it. `gate` counts the frames that it refuses. Raises
    RecordingError where recorded masks are to be used and none of them is a frame's.
    """

    def __init__(self, recording: Recording, config: Config) -> None:
        self.autopilot = Autopilot(
            config.mavlink,
            config.camera.mount,
            replay=True,
            pose_errors=told_errors(config),
            camera=config.camera,
        )
        self.reader = TlogReader(recording.tlog_path)
        self.framer = Framer()
        self.gate = FrameGate(config, self.autopilot)
        if config.segmenter.kind == "recorded":
            recording.check_masks()
        self.first_pose: CameraPose | None = None
        self.last_pose: CameraPose | None = None
        self.probes: Counter[str] = Counter()
        self.stamp_ns = 0  # of what was read last
        self._began_ns = 0
        self._recording = recording
        self._most_pixels = config.camera.width * config.camera.height
        self._next_probe_ns = 0
        self._waiting: deque[tuple[int, str]] = deque()

    def pairs(self, on_stamp: Callable[[int], None]) -> Iterator[tuple[Frame, CameraPose]]:
        """Each frame with a picture and a pose, to the log's end; `autopilot` is then as it was when it was taken.

        `on_stamp` gets the log's time in ns. Raises RecordingError where the log holds no MAVLink frame.
        """
        frames = deque(even_rows(self._recording.rows(), self._spans()))
        stamp_ns = 0
        for stamp_us, raw in self.reader:
            self.stamp_ns = stamp_ns = stamp_us * 1000
            self._began_ns = self._began_ns or stamp_ns
            on_stamp(stamp_ns)
            while frames and frames[0][0] <= stamp_us:
                self._waiting.append(frames.popleft())
            for mav_frame in self.framer.feed(raw):
                self.autopilot.receive(mav_frame, stamp_ns)
            yield from self._take_waiting(stamp_ns)
            self._probe(stamp_ns)
        self._waiting.extend(frames)
        last_ns = self._waiting[-1][0] * 1000 if self._waiting else 0
        yield from self._take_waiting(max(stamp_ns, last_ns) + _FLUSH_NS)

    def _spans(self) -> list[Span]:
        """The stretches of the log on one clock: where a clock was set, they say when a frame was taken."""
        survey = TlogReader(self._recording.tlog_path)
        deque(survey, maxlen=0)
        if survey.unstamped > survey.frames:
            raise RecordingError(
                f"{survey.path}: {survey.unstamped} MAVLink frames without stamps: a raw stream, not a telemetry log, "
                "which has the microseconds in 8 bytes before each frame"
            )
        if not survey.frames:
            raise RecordingError(f"{survey.path}: holds no MAVLink frame: is it a telemetry log?")
        return survey.spans

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
        """What the gate lets pass of the frames whose pose is known by now, or why there is none.

        A picture is loaded no earlier, and only where it was taken during the log or has a pose: in flight it was
        looked at as well, though its pose was refused, and the next one may be its repetition.
        """
        while self._waiting:
            stamp_us, name = self._waiting[0]
            pose = self.autopilot.camera_pose(stamp_us * 1000, now_ns)
            if pose is None:
                return
            self._waiting.popleft()
            if isinstance(pose, RejectReason) and not self._began_ns <= stamp_us * 1000 <= self.stamp_ns:
                self.gate.rejects[pose] += 1
                continue
            frame = self._loaded(stamp_us, name)
            if frame is None or self.gate.admit(frame) is not None:
                continue
            if isinstance(pose, RejectReason):
                self.gate.rejects[pose] += 1
            else:
                yield frame, pose

    def _loaded(self, stamp_us: int, name: str) -> Frame | None:
        try:
            picture = self._recording.load_picture(name, self._most_pixels)
        except FileRefusedError as error:
            if not self.gate.rejects[RejectReason.BAD_FRAME]:
                log.warning("a frame is not used, and from now on such frames are only counted: %s", error)
            self.gate.rejects[RejectReason.BAD_FRAME] += 1
            return None
        if picture is None:
            return Frame(stamp_us * 1000, name, None)
        return Frame(stamp_us * 1000, name, picture.image, picture.orientation)
