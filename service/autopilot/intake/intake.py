"""From frames on the links to the decoded messages of our vehicle: no echo, no copy, no other vehicle. No I/O."""

from collections import Counter
from collections.abc import Callable, Container
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.autopilot.intake.followed import Followed
from service.autopilot.intake.sequences import SequenceLosses
from service.autopilot.message_ids import HEARTBEAT, PAYLOAD_IDS, TIMESYNC, VEHICLE_POSE_IDS, ZOOM_IDS
from service.autopilot.requests import AUTOPILOT_COMPONENT, COMPUTER_COMPONENT
from service.common.messages import MavFrame
from service.mavlink.copies import Copies, Verdict
from service.mavlink.framer import Decoder

OWN_COMPONENTS = (COMPUTER_COMPONENT, 100)  # the second is the camera's


class Intake:
    """`on_change` is called when another autopilot is followed than before, before its heartbeat is given out.

    With `on_own` our own frames, recorded in a log, are no echo: it gets the TIMESYNC requests among them.
    """

    def __init__(
        self,
        target_system: int,
        wanted: Container[int],
        on_change: Callable[[], None],
        on_own: Callable[[Any, int], None] | None,
    ) -> None:
        self.messages: Counter[str] = Counter()
        self.ignored: Counter[str] = Counter()
        self.losses = SequenceLosses()
        self.followed = Followed(target_system, is_live=on_own is None)
        self.heartbeat_ns: int | None = None  # the last of the autopilot that is followed
        self._wanted, self._on_change, self._on_own = wanted, on_change, on_own
        self._copies = Copies()
        self._decoder = Decoder()

    def take(self, frame: MavFrame, now_ns: int) -> Any | None:
        """The message of a frame that arrived at `now_ns`, if it is wanted and of our vehicle."""
        if not self._is_new(frame, now_ns) or frame.message_id not in self._wanted:
            return None
        if frame.component == AUTOPILOT_COMPONENT:
            self._choose(frame, now_ns)
        if not self._is_of_vehicle(frame):
            self.ignored["foreign"] += 1
            return None
        if self.heartbeat_ns is None and frame.message_id != HEARTBEAT:
            self.ignored["before_heartbeat"] += 1
            return None
        message = self._decoder.decode(frame)
        if message is None:
            self.ignored["undecodable"] += 1
        elif frame.message_id != HEARTBEAT or message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            self.messages[message.get_type()] += 1
            return message
        return None

    def _replayed_sent(self, frame: MavFrame, now_ns: int) -> None:
        """Take a frame that we sent when the log was recorded; it may come before the autopilot is known."""
        if self._on_own is None or frame.message_id != TIMESYNC or frame.component != COMPUTER_COMPONENT:
            return
        message = self._decoder.decode(frame)
        if message is not None and message.tc1 == 0:
            self._on_own(message, now_ns)

    def _is_new(self, frame: MavFrame, now_ns: int) -> bool:
        """Whether it is somebody else's, checked, and the first of its copies."""
        if not frame.is_known:
            self.losses.heard_unchecked(frame.system, frame.component, frame.sequence)
            return False
        is_ours, verdict = self._is_ours(frame), self._copies.judge(frame, now_ns)
        if is_ours and self._on_own is None:
            self.ignored["echo"] += 1
            return False
        if not is_ours:
            self.losses.heard(frame.system, frame.component, frame.sequence, is_copy=verdict is not Verdict.NEW)
        if verdict is Verdict.COPY:
            self.ignored["copy"] += 1
        elif is_ours:
            self._replayed_sent(frame, now_ns)
        return verdict is not Verdict.COPY and not is_ours

    def _is_ours(self, frame: MavFrame) -> bool:
        """Sent by us and come back; of a camera's words we send only CAMERA_FOV_STATUS, which `zoom` knows for ours."""
        is_own = frame.component in OWN_COMPONENTS and frame.message_id not in ZOOM_IDS
        return is_own and self.followed.system in (0, frame.system)

    def _is_of_vehicle(self, frame: MavFrame) -> bool:
        is_part = frame.component == AUTOPILOT_COMPONENT or frame.message_id in PAYLOAD_IDS
        return is_part and self.followed.system in (0, frame.system)

    def _choose(self, frame: MavFrame, now_ns: int) -> None:
        """Heed what a frame of an autopilot's component says of whom to follow."""
        if frame.message_id in VEHICLE_POSE_IDS:
            self.followed.pose(frame.system)
        if frame.message_id != HEARTBEAT:
            return
        message, before = self._decoder.decode(frame), self.followed.system
        is_autopilot = message is not None and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
        if is_autopilot and self.followed.heartbeat(frame.system, now_ns) and before != 0:
            self.heartbeat_ns = None
            self._on_change()
