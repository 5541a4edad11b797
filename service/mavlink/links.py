"""All links as one: whole frames in, signed frames out, each of them recorded; the composition root owns it."""

import time
from collections.abc import Callable
from typing import Protocol

from service.common.messages import MavFrame
from service.config.endpoint import parse_endpoint
from service.config.sections import LinkConfig, MavlinkConfig
from service.mavlink.link import Link
from service.mavlink.signing import LinkSigning, is_signed, signing_of_links

OnFrame = Callable[[Link, MavFrame, int], None]


class Telemetry(Protocol):
    """Takes what is recorded."""

    def telemetry(self, stamp_ns: int, raw: bytes) -> None:
        """One whole frame, heard or sent."""


class MavlinkLinks:
    """Calls `on_frame(link, frame, now_ns)`, on the event loop, for each frame that its link's signing accepts."""

    def __init__(self, config: MavlinkConfig, recorder: Telemetry, on_frame: OnFrame) -> None:
        self.links = [Link(parse_endpoint(link.url), self._on_bytes) for link in config.links]
        self._recorder, self._on_frame = recorder, on_frame
        self._signing = dict(zip(self.links, signing_of_links(config, time.time_ns), strict=True))
        self._roles = dict(zip(self.links, config.links, strict=True))

    def faces_autopilot(self, link: Link) -> bool:
        """Whether its other end is the autopilot, not a ground station."""
        return self._roles[link].faces == "autopilot"

    @property
    def has_adsb(self) -> bool:
        """Whether some ground station wants ADSB_VEHICLE."""
        return any(_takes_adsb(role) for role in self._roles.values())

    def send(self, link: Link, data: bytes, now_ns: int) -> None:
        """A frame to one link."""
        signed = self._signing[link].signed(data)
        link.send(signed)
        self._recorder.telemetry(now_ns, signed)

    def send_all(self, data: bytes, now_ns: int) -> None:
        """A frame to every link."""
        for link in self.links:
            self.send(link, data, now_ns)

    def send_autopilot(self, data: bytes, now_ns: int) -> None:
        """A frame to the links that face the autopilot."""
        for link in self.links:
            if self.faces_autopilot(link):
                self.send(link, data, now_ns)

    def send_adsb(self, data: bytes, now_ns: int) -> None:
        """A frame to the ground stations that want ADSB_VEHICLE."""
        for link, role in self._roles.items():
            if _takes_adsb(role):
                self.send(link, data, now_ns)

    def counters(self) -> dict[str, dict[str, object]]:
        """Figures of each link for the status."""
        return {link.name: link.counters() | _refused(self._signing[link]) for link in self.links}

    def _on_bytes(self, link: Link, data: bytes) -> bool:
        now_ns, signing = time.monotonic_ns(), self._signing[link]
        frames = [frame for frame in link.whole_frames(data) if signing.accepts(frame)]
        for frame in frames:
            self._recorder.telemetry(now_ns, frame.raw)
            self._on_frame(link, frame, now_ns)
        return any(frame.is_known and (is_signed(frame) or not signing.is_on) for frame in frames)


def _takes_adsb(role: LinkConfig) -> bool:
    return role.adsb and role.faces == "ground"


def _refused(signing: LinkSigning) -> dict[str, object]:
    return {"refused": dict(sorted(signing.refused.items()))} if signing.is_on else {}
