"""The card's figures: the threshold is validation's, the error is that of so many fires."""

from pathlib import Path

import numpy as np
import pytest

from card import Scored, Scores, share_error, write_card, write_cross_validation
from distloc.study.segmentation import ImageScore

NAN = float("nan")


def score(is_smoke: bool, is_found: bool = False, false: int = 0) -> ImageScore:
    return ImageScore(is_smoke, is_found, NAN, NAN, NAN, 3.0 if is_found else NAN, NAN, false, None)


def scores() -> Scores:
    """Two fires of validation and a clip without smoke; a third fire, cross-validated, that is all false at 0.9."""
    frames = [
        Scored("drawn", "20180101", 0, True, False),
        Scored("boxes", "20180102", 0, False, False),
        Scored("clear", "a2", 0, True, True),
        Scored("boxes", "20180103", 1, False, True),
    ]
    low = [score(True, True), score(True, True, 1), score(False, false=1), score(True, True)]
    high = [score(True, True), score(True), score(False), score(True, False, 9)]
    return Scores(["clear", "drawn"], frames, {0.5: low, 0.9: high}, ["20180101", "20180102"], ["clear"])


def test_the_error_is_of_fires_not_frames() -> None:
    assert share_error([[True] * 10, [False] * 10]) == pytest.approx(0.5)
    assert share_error([[True, False]] * 5) == 0.0
    assert np.isnan(share_error([[True, False, True]])) and np.isnan(share_error([]))


def test_the_threshold_is_chosen_on_validation_alone() -> None:
    assert scores().threshold() == 0.9  # at 0.5 something false; the nine at 0.9 are of another fold


def test_a_margin_asks_for_less_that_is_false() -> None:
    frames = [Scored("boxes", "20180101", 0, False, False)] * 10
    found = [score(True, True)] * 10
    of = Scores([], frames, {0.5: [score(True, True, 2), *found[1:]], 0.9: found}, ["20180101"], [])
    assert (of.threshold(), of.threshold(0.5)) == (0.5, 0.9)  # 0.2 beside is allowed, 0.1 with the margin


def test_the_card_tells_what_was_measured_from_what_was_fitted_to(tmp_path: Path) -> None:
    model = tmp_path / "net.onnx"
    model.write_bytes(b"x" * 4096)
    write_card(tmp_path / "net.md", model, "2.0", "ab" * 32, 0.9, "768 x 432", "--seed 0", scores())
    said = (tmp_path / "net.md").read_text()
    assert "train.py --seed 0` --real clear drawn --measure boxes" in said
    rows = [line.split() for line in said.splitlines()]
    assert ["validation", "boxes", "1", "1", "0", "of", "1", "0.00", "0.00", "-", "-"] in rows
    assert ["cross-validated", "20180103", "*", "1", "1", "0", "of", "1", "0.00", "9.00", "-", "-"] in rows
    assert ["0.9", "1", "of", "2", "0.00", "0.00", "0", "of", "1", "9.00", "-"] in rows
    assert ["validation", "clear", "*", "1", "1", "-", "-", "-", "0.00", "-"] in rows
    assert "was fitted to clear" in said  # what a star says: the model that the fitting began with saw it
    assert "by 1 networks" in said and "validated network is the one that ships" not in said


def test_a_cross_validation_alone_has_its_own_threshold_and_says_how_it_was_fitted(tmp_path: Path) -> None:
    whole = scores()
    of_fold = [score(True, True, 1)], [score(True, True)]
    folds = Scores(whole.fitted, whole.frames[3:], dict(zip((0.5, 0.9), of_fold, strict=True)), ["20180101"], ["clear"])
    write_cross_validation(tmp_path / "folds.md", "--real-steps 400", folds)
    said = (tmp_path / "folds.md").read_text()
    assert "1 networks" in said and "train.py --real-steps 400`" in said
    assert "The threshold, 0.9," in said and "was fitted to clear" in said
    rows = [line.split() for line in said.splitlines()]
    assert ["cross-validated", "20180103", "*", "1", "1", "1", "of", "1", "1.00", "0.00", "-", "3.0"] in rows
