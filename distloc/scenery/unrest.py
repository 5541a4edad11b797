"""Whether the scenery stands still, by how well the window's places fit; the compass has one.

Waves and drifting ice are followed as well as rocks are, but their residuals are alike from keyframe to keyframe, the
more so the larger they are. Stamps that jitter make large residuals too, and such are not alike.
"""

from distloc.scenery.window import Window

LEAST_KEYFRAMES, _WARY_KEYFRAMES = 5, 20  # in the window, to be believed; the latter once something moved
_LEAST_PLACES = 8
_SHARE = 0.3  # how fast all three are learnt
_RESTLESS, _STILL = 0.17, 0.1  # mean product of residuals that follow each other, of a corner's told variance
_ROUGH = 1.8  # mean squared residual, of the usual one: above it these hold instead, as for waves
_ROUGH_ALIKE, _ROUGH_STILL = 0.03, 0.02
_MOST_WRONG, _LONGEST_RESTLESS = 0.25, 15  # a share of the places; keyframes


class Unrest:
    """`needed` keyframes must be in the window for its answer to be believed."""

    def __init__(self) -> None:
        self.is_restless, self.needed = False, LEAST_KEYFRAMES
        self._alike, self._rough, self._wrong = 0.0, 0.0, 0.0
        self._keyframes = 0  # in a row

    def is_moving(self, window: Window) -> bool:
        """After a solved keyframe.

        The window begins anew once it is over, for what it holds is of what moved; and where it lasts, for it may be
        what is held that does not fit.
        """
        self._learn(window)
        is_rough = self._rough > _ROUGH
        is_still = self._alike < (_ROUGH_STILL if is_rough else _STILL) and self._wrong < _MOST_WRONG / 2.0
        if self.is_restless and is_still:
            window.reset()
            self.is_restless = False
            return True
        begins, goes_on = (_ROUGH_ALIKE, _ROUGH_STILL) if is_rough else (_RESTLESS, _STILL)
        self.is_restless = self._alike > (goes_on if self.is_restless else begins) or self._wrong > _MOST_WRONG
        self._keyframes = self._keyframes + 1 if self.is_restless else 0
        if self.is_restless:
            self.needed = min(_WARY_KEYFRAMES, window.size)
        if self._keyframes % _LONGEST_RESTLESS == _LONGEST_RESTLESS - 1:
            window.reset()
        return self.is_restless

    def believed(self) -> None:
        """An answer was believed: the next need not wait as long."""
        self.needed = LEAST_KEYFRAMES

    def _learn(self, window: Window) -> None:
        if window.count < LEAST_KEYFRAMES:
            return
        self._alike += _SHARE * (window.misfit * window.likeness - self._alike)
        if window.used >= _LEAST_PLACES:
            share = 1.0 if window.count == LEAST_KEYFRAMES else _SHARE
            self._rough += share * (window.roughness - self._rough)
        self._wrong += _SHARE * (window.wrong / max(window.wrong + window.used, 1) - self._wrong)
