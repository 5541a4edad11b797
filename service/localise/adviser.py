"""Asks where to fly next for each fire that is not sure enough, off the frames' way. The localise stage calls it."""

import logging
import math
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from distloc.advice.advise import Advice, advise
from distloc.advice.ways import Craft
from distloc.localizer import Localizer
from distloc.tracks.estimates.outlook import Outlook
from distloc.types import TargetEstimate, TargetState
from service.config.sections import Config

log = logging.getLogger(__name__)

_EVERY_S = 3.0  # one target at a time
_LASTS_S = 30.0  # then the craft is elsewhere
_MOST = 64
_VIEW_SHARE = 0.8  # of the half view: at the border a plume is cut
_UNSURE = (TargetState.TENTATIVE, TargetState.CONFIRMED)

Job = Callable[[], None]


class AdviceWorker:
    """Runs one job at a time on a thread of its own; what comes meanwhile is left out."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="advise")
        self._is_busy = False

    def __call__(self, job: Job) -> None:
        """Have it run, if none is running."""
        if self._is_busy:
            return
        self._is_busy = True
        self._pool.submit(self._run, job)

    def close(self) -> None:
        """No more; one that runs takes some hundredths of a second."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _run(self, job: Job) -> None:
        try:
            job()
        except Exception:  # whatever fails costs this advice alone
            log.exception("no advice")
        finally:
            self._is_busy = False


def craft_of(config: Config) -> Craft:
    """As `[advice]`, the camera and its mount say."""
    camera, section, mount = config.camera.camera(), config.advice, config.camera.mount
    edges = camera.rays(np.array([[0.0, camera.width - 1.0], [camera.cy, camera.cy]]))
    half_view_rad = _VIEW_SHARE * float(np.arctan2(np.abs(edges[0]), edges[2]).min())
    return Craft(
        speed_mps=section.speed_mps,
        flight_s=section.flight_s,
        keeps_target=mount.gimbal or section.nose == "target",
        has_gimbal=mount.gimbal,
        half_view_rad=max(half_view_rad, 1e-3),
        camera_yaw_rad=0.0 if mount.gimbal else math.radians(mount.yaw_deg),
    )


class Adviser:
    """Holds an advice for each fire that needs one. `run` runs a job: at once in a replay, on a thread in flight."""

    def __init__(self, config: Config, run: Callable[[Job], None] = lambda job: job()) -> None:
        self._section, self._craft, self._run = config.advice, craft_of(config), run
        self._held: dict[int, tuple[float, Advice | None]] = {}  # written as a whole: another thread reads
        self._asked_s = -math.inf

    def ask(self, localizer: Localizer, estimates: Iterable[TargetEstimate], stamp_s: float) -> None:
        """Have the one worked out that is due, if any; from the thread that steps the localizer."""
        if not self._section.enabled or 0.0 <= stamp_s - self._asked_s < _EVERY_S:
            return
        due = [one for one in estimates if self._is_unsure(one)]
        if not due:
            self._held = {}
            return
        wanted = {one.id for one in due}
        held = {target: one for target, one in self._held.items() if target in wanted}
        one = min(due, key=lambda each: (held.get(each.id, (-math.inf, None))[0], each.ellipse95.semi_major_m))
        self._asked_s, self._held = stamp_s, held
        outlook = localizer.outlook(one.id)
        if outlook is not None:
            half_m = one.ellipse95.semi_major_m
            self._run(lambda: self._advise(outlook, half_m, stamp_s))

    def current(self, target: int, stamp_s: float) -> Advice | None:
        """What holds for a target at a time; from any thread."""
        at_s, advice = self._held.get(target, (-math.inf, None))
        return advice if 0.0 <= stamp_s - at_s <= _LASTS_S else None

    def _is_unsure(self, one: TargetEstimate) -> bool:
        return one.state in _UNSURE and one.misses == 0 and one.ellipse95.semi_major_m > self._section.enough_m

    def _advise(self, outlook: Outlook, half_length_m: float, stamp_s: float) -> None:
        try:
            advice = advise(outlook, self._craft, half_length_m)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError):
            log.warning("no advice for target %d", outlook.id, exc_info=True)
            advice = None
        held = {**self._held, outlook.id: (stamp_s, advice)}
        self._held = dict(list(held.items())[-_MOST:])
