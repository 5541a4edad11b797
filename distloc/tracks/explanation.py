"""What is known of what was seen, and why it is not confirmed; `Localizer.explain` returns it."""

from dataclasses import dataclass

from distloc.backports import StrEnum
from distloc.tracks.life import BURST_S, CONFIRM_SIGHTINGS, CONFIRM_WINDOW, NEAR_M, TrackLife
from distloc.tracks.plausibility import LEAST_EXTENT_M, MOST_ABOVE_M
from distloc.types import TargetState


class Lack(StrEnum):
    """What a track lacks to be confirmed; `words` says it and what helps."""

    SIGHTINGS = "sightings"
    CONTRADICTED = "contradicted"
    RANGE_UNBOUNDED = "range_unbounded"
    BASELINE = "baseline"
    SCENERY = "scenery_about_to_tell"
    TOO_CLOSE = "too_close_to_other"
    MAY_MOVE = "may_move"
    IN_THE_SKY = "in_the_sky"
    TOO_SMALL = "too_small"
    ON_THE_LENS = "on_the_lens"
    BURST = "burst_close_by"
    NO_PLACE = "no_place"

    @property
    def words(self) -> str:
        """For people."""
        return _WORDS[self]


_WORDS = {
    Lack.SIGHTINGS: f"seen in fewer than {CONFIRM_SIGHTINGS} of the last {CONFIRM_WINDOW} steps that could show it",
    Lack.CONTRADICTED: "its sightings contradicted one place, so more of them are needed than at first",
    Lack.RANGE_UNBOUNDED: "it may be as far as anything: fly across the line of sight",
    Lack.BASELINE: "its ellipse is too long for its range: fly further across the line of sight",
    Lack.SCENERY: "the scenery is about to measure the heading: wait",
    Lack.TOO_CLOSE: "its segment is that of another target, at about the same place",
    Lack.MAY_MOVE: "it may drive or float, as dust and ships do: fly another course past it",
    Lack.IN_THE_SKY: f"by its likeliest range its foot is {MOST_ABOVE_M:.0f} m over ground or craft, as a cloud's is",
    Lack.TOO_SMALL: f"it is smaller than {LEAST_EXTENT_M:.0f} m, as a bird is",
    Lack.ON_THE_LENS: "it stays where it is in the image, as dirt on the lens does",
    Lack.BURST: f"it may be within {NEAR_M:.0f} m and was seen for under {BURST_S:.0f} s, as birds are: wait",
    Lack.NO_PLACE: "all places are taken by targets that are no less useful: it is not reported",
}


@dataclass(frozen=True, slots=True)
class TrackExplanation:
    """One track. `id` and `state` are None for a candidate, which is not reported yet.

    `sightings` are those in the last 12 steps that could have shown it, `range95_m` the 2.5 and 97.5 % quantiles of the
    range, `lacks` what keeps it from being confirmed: empty where it is, or where the next step may do it.
    """

    id: int | None
    state: TargetState | None
    sightings: int
    range95_m: tuple[float, float]
    lacks: tuple[Lack, ...]

    @property
    def words(self) -> str:
        """What is lacking, for people; empty where nothing is."""
        return "; ".join(lack.words for lack in self.lacks)


@dataclass(frozen=True, slots=True)
class Explanation:
    """All tracks, the most useful first, and the places: for targets that are reported, and for candidates.

    `left_out` are segments that no track explained and that got no place, in the last step and in all of them.
    """

    tracks: tuple[TrackExplanation, ...] = ()
    places: int = 0
    places_used: int = 0
    candidate_places: int = 0
    candidates: int = 0
    left_out: int = 0
    left_out_ever: int = 0


def lacks_of(
    life: TrackLife, is_bounded: bool, is_short: bool, is_awaited: bool, is_shared: bool, is_standing: bool
) -> list[Lack]:
    """What a tentative target lacks, by whether its ellipse is short enough for its range and so on."""
    found = (
        (Lack.SIGHTINGS, not life.is_seen_enough),
        (Lack.CONTRADICTED, life.is_seen_enough and life.is_doubted),
        (Lack.RANGE_UNBOUNDED, not is_bounded),
        (Lack.BASELINE, is_bounded and not is_short),
        (Lack.SCENERY, is_awaited),
        (Lack.TOO_CLOSE, is_shared),
        (Lack.MAY_MOVE, is_bounded and not is_standing),
    )
    return [lack for lack, is_so in found if is_so]
