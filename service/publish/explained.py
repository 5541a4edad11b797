"""What the status says of all that was seen, and why it is not confirmed."""

from distloc.tracks.explanation import Explanation, TrackExplanation
from service.publish.wire import ExplainReport, TrackReport, rounded

MOST_TRACKS = 8  # in a status: the most useful ones


def report_from_explanation(explanation: Explanation) -> ExplainReport:
    """The part of the status, with the most useful tracks."""
    return ExplainReport(
        tracks=[_track(one) for one in explanation.tracks[:MOST_TRACKS]],
        places=explanation.places,
        places_used=explanation.places_used,
        candidate_places=explanation.candidate_places,
        candidates=explanation.candidates,
        left_out=explanation.left_out,
        left_out_ever=explanation.left_out_ever,
    )


def _track(one: TrackExplanation) -> TrackReport:
    return TrackReport(
        target=one.id,
        state="candidate" if one.state is None else one.state.value,
        sightings=one.sightings,
        range95_m=[rounded(value) for value in one.range95_m],
        lacks=[lack.value for lack in one.lacks],
        says=one.words,
    )
