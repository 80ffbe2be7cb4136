"""What is said of views that disagree: how they were tested, and what would explain it.

Nothing of images or surfaces is in it, so that single points can be compared without either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array

#: Probability of rejecting any view of a clean session.
FAMILY = 0.01
#: Views below which nothing can be tested between them: three components take three views.
LEAST_VIEWS = 4
#: Misfit, over that of the stated noise, above which bounds are too small: by a tenth. Of 16 clean
#: sessions of a panel, four to six views, 21 to 41 pixels a side, one to four lines, 0.97 to 1.05.
LARGE_MISFIT = 1.21
#: Least number of pixels that a view is compared by.
LEAST_PIXELS = 30
#: Named factors that a view may be wrong by.
NAMED = {"sign": -1.0, "rms": 0.5**0.5, "inverse_rms": 2.0**0.5}
#: The same of a view that is conjugated.
CONJUGATES = {"conjugate": 1.0, "conjugate_sign": -1.0}
#: Gap of the criterion between two views below which it cannot be told which is wrong.
CLEAR = 6.0
#: Smallest modulus of a factor that a fit is started from.
SMALLEST = 0.05
#: Misfit that no mistake of one view leaves; more, and views may be exchanged.
UNEXPLAINED = 1.3
#: Numbers of a pose: three of a rotation vector, three of the origin.
POSE = 6


@dataclass(frozen=True, eq=False)
class ViewTests:
    """Tests of every view.

    Attributes
    ----------
    statistic, p_value : dict of str to ndarray, shape (view,)
        ``factor``, ``pose``, ``origin`` and ``whole``: F statistics.
    misfit : float
        Squares over their expectation from the stated noise.
    misfit_p_value : float
        Two-sided, of the stated noise.
    """

    statistic: dict[str, Array]
    p_value: dict[str, Array]
    misfit: float
    misfit_p_value: float

    @property
    def least(self) -> float:
        """Smallest p-value of the family, times its number."""
        all_of = np.concatenate(list(self.p_value.values()))
        return float(min(1.0, all_of.min() * len(all_of)))

    @property
    def strongest(self) -> tuple[str, int]:
        """Name of the test with the smallest p-value, and the view that it is of."""
        test = min(self.p_value, key=lambda name: float(self.p_value[name].min()))
        return test, int(self.p_value[test].argmin())

    @property
    def rejects(self) -> bool:
        """True if a view is wrong."""
        return self.least < FAMILY


@dataclass(frozen=True)
class Explanation:
    """One way to explain the data.

    Attributes
    ----------
    view : tuple of int
        That are wrong; none for a clean session.
    kind : str
        ``clean``, ``sign``, ``conjugate``, ``conjugate_sign``, ``rms``, ``inverse_rms``, ``gain``,
        ``phase``, ``factor``, ``pose``, ``direction``, ``other_field``, ``other_values``,
        ``own_noise``, ``offset`` or ``exchanged``.
    criterion : float
        The smaller, the better.
    factor : complex
        That the view's velocities stand to those that the others predict.
    factor_std : tuple of float
        Standard errors of its modulus, relative, and of its argument, rad.
    pose : tuple of float
        Rotation vector (rad) and displacement (m) by which a pose is off.
    free : tuple of int
        Numbers of that pose whose prior was taken away.
    covariance : ndarray, shape (6, 6), optional
        Of that pose.
    misfit : float
        Squares that it leaves over those of the noise.
    places : tuple of str
        Points and frequencies at which alone the view has ``other_values``.
    noise : float
        Of ``own_noise``: the noise that the view has over the one that it states, as of the others.
    """

    view: tuple[int, ...]
    kind: str
    criterion: float
    factor: complex = 1.0
    factor_std: tuple[float, float] = (np.nan, np.nan)
    pose: tuple[float, ...] = ()
    free: tuple[int, ...] = ()
    covariance: Array | None = None
    misfit: float = np.nan
    places: tuple[str, ...] = ()
    noise: float = np.nan

    @property
    def explains(self) -> bool:
        """False if more is left than noise: more than this mistake was made."""
        return not self.misfit > UNEXPLAINED


def tells_views_apart(ranked: Sequence[Explanation]) -> tuple[Explanation, Explanation | None]:
    """Take the best explanation and, if it is not clear which view is wrong, that of another.

    Returns
    -------
    Explanation
    Explanation or None
        The best about another view, if its criterion is within `CLEAR`.
    """
    wrong = [h for h in ranked if h.view]
    best = wrong[0]
    other = next((h for h in wrong if set(h.view) != set(best.view)), None)
    near = other is not None and other.criterion - best.criterion < CLEAR
    return best, other if near else None
