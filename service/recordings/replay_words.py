"""What a replay made of its recording in one line: frames used and not used, and whether poses came; `cli` says it."""

from collections import Counter
from dataclasses import dataclass

NO_POSE_WORDS = {
    "no_clock": "no TIMESYNC and no time since boot",
    "no_fix": "the GPS had no fix",
    "ekf_unhealthy": "the autopilot called its estimate poor",
    "position_invalid": "positions of 0, 0 or out of range",
    "position_jumped": "the position jumped",
    "attitude_invalid": "attitudes out of range",
    "no_pose": "no attitude or no position before it",
    "stale_pose": "no attitude or no position after it",
    "pose_gap": "attitudes or positions too rare",
}


@dataclass(frozen=True, slots=True)
class Outcome:
    """Counts of one replay: frames by what became of them, seconds of the log by whether there was a pose."""

    localised: int
    rejects: Counter[str]
    bad_rows: Counter[str]
    seconds: Counter[str]  # "pose", else the reason; asked for once a second
    has_table: bool
    is_bare: bool  # a log alone, which has no frames
    wild: int = 0
    steps: int = 0
    faint_masks: int = 0
    has_unused_masks: bool = False
    mount: str | None = None  # what of the camera's mount is surely off

    @property
    def is_useful(self) -> bool:
        """Whether anything could be used; of a log alone that is a pose."""
        return self.localised > 0 or (self.is_bare and self.seconds["pose"] > 0)

    def __str__(self) -> str:
        parts = [self._frames(), self._poses()]
        if self.bad_rows:
            parts.append(f"bad rows in frames.csv: {listed(self.bad_rows)}")
        if self.faint_masks:
            parts.append(f"{self.faint_masks} masks have no pixel above 127 though some above 0: smoke is 255 (or 1)")
        if self.has_unused_masks and not self.localised:
            parts.append("its masks are not used: segmenter.kind = 'recorded' in a --config takes them")
        if self.wild:
            parts.append(f"{self.wild} records of the log with wild stamps left out")
        if self.steps:
            parts.append(f"the log's clock was set {self.steps} times: put right")
        return "; ".join(parts)

    def _frames(self) -> str:
        refused = self.rejects.total()
        if not self.localised and not refused:
            return "no frames: " + (
                "a log alone" if self.is_bare else "frames.csv has none" if self.has_table else "no frames.csv"
            )
        text = f"{self.localised} of {self.localised + refused} frames used"
        return f"{text}, not used: {listed(self.rejects)}" if refused else text

    def _poses(self) -> str:
        seconds, posed = self.seconds.total(), self.seconds["pose"]
        text = f"poses in {posed} of {seconds} s" if posed else f"no pose in {seconds} s"
        others = Counter({_with_words(reason): count for reason, count in self.seconds.items() if reason != "pose"})
        return f"{text}, else {listed(others)}" if others else text


def _with_words(reason: str) -> str:
    return f"{reason} ({NO_POSE_WORDS[reason]})" if reason in NO_POSE_WORDS else reason


def listed(counts: Counter[str]) -> str:
    """Counts by reason, the most first."""
    return ", ".join(f"{count} {reason}" for reason, count in sorted(counts.items(), key=lambda one: (-one[1], one[0])))
