import json

import msgspec

from distloc.tracks.explanation import Explanation, Lack, TrackExplanation
from distloc.types import TargetState
from service.publish.explained import MOST_TRACKS, report_from_explanation
from service.publish.wire import StatusReport, encode

TENTATIVE = TrackExplanation(7, TargetState.TENTATIVE, 9, (812.12345, float("inf")), (Lack.RANGE_UNBOUNDED,))
CANDIDATE = TrackExplanation(None, None, 2, (50.0, 30_000.0), (Lack.SIGHTINGS, Lack.NO_PLACE))


def test_the_status_says_what_each_track_lacks() -> None:
    said = Explanation((TENTATIVE, CANDIDATE), places=64, places_used=1, candidate_places=24, candidates=1, left_out=3)
    status = StatusReport(vehicle="drone1", time_utc=None, state="ok", explain=report_from_explanation(said))
    explain = json.loads(encode(status))["explain"]
    first, second = explain.pop("tracks")
    assert first == {
        "target": 7,
        "state": "tentative",
        "sightings": 9,
        "range95_m": [812.123, None],
        "lacks": ["range_unbounded"],
        "says": "it may be as far as anything: fly across the line of sight",
    }
    assert (second["target"], second["state"], second["lacks"]) == (None, "candidate", ["sightings", "no_place"])
    assert explain == {
        "places": 64,
        "places_used": 1,
        "candidate_places": 24,
        "candidates": 1,
        "left_out": 3,
        "left_out_ever": 0,
    }


def test_the_status_has_a_few_tracks_however_many_there_are() -> None:
    report = report_from_explanation(Explanation((TENTATIVE,) * 3 + (CANDIDATE,) * 85))
    assert [one.state for one in report.tracks] == ["tentative"] * 3 + ["candidate"] * (MOST_TRACKS - 3)


def test_a_status_from_before_has_no_explanation() -> None:
    old = b'{"vehicle": "drone1", "time_utc": null, "state": "ok"}'
    assert msgspec.json.decode(old, type=StatusReport).explain is None
