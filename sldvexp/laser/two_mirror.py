"""`laser=two_mirror`: galvanometer mirrors with offset, orthogonal axes, and their D/A board."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.units import AngleUnit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

MIRRORS = ("up_down", "left_right")

#: Steps of u at which a calibration's slope is looked at.
MONOTONIC_GRID = 1000


class Board(Enum):
    """D/A converters by their range of steps."""

    bits_12_sign = (-4096, 4096)
    bits_16 = (-32768, 32767)


@dataclass
class Mirror:
    """One mirror's calibration, ``angle = zero + gain u + sum_k polynomial[k] u**(k + 2)``.

    `u` is the DAC step over the board's largest step, so that a calibration holds for any board.

    Parameters
    ----------
    gain : float
        Angle at full scale (u = 1). Negative for a mirror wired the other way round. By default one
        of 4096 steps is 0.0061 deg: Figure 4.29 prints s as 0.0055 deg and as 0.9039 steps.
    zero : float
        Angle at step 0.
    polynomial : list of float
        Coefficients of u^2, u^3 and so on.
    unit : AngleUnit
        Unit of the numbers above.
    """

    gain: float = 25.0
    zero: float = 0.0
    polynomial: list[float] = field(default_factory=list)
    unit: AngleUnit = AngleUnit.deg

    @property
    def coefficients(self) -> list[float]:
        """Polynomial coefficients in rad, ascending powers of u."""
        scale = self.unit.value
        return [scale * c for c in (self.zero, self.gain, *self.polynomial)]

    def check(self, checks: Checks, name: str, board: Board) -> None:
        """Note under `name` what makes this calibration useless on a board."""
        known = len(checks.problems)
        checks.finite(f"{name}.gain", self.gain)
        checks.finite(f"{name}.zero", self.zero)
        checks.finite(f"{name}.polynomial", *self.polynomial)
        checks.require(
            self.gain != 0, f"{name}.gain", "must not be zero: the mirror would not move"
        )
        if len(checks.problems) > known:
            return
        lowest = board.value[0] / board.value[1]
        grid = [lowest + (1.0 - lowest) * i / MONOTONIC_GRID for i in range(MONOTONIC_GRID + 1)]
        turns = next((u for u in grid if self._slope(u) * self.gain <= 0), None)
        checks.require(
            turns is None,
            f"{name}.polynomial",
            f"the angle must grow or shrink over the whole range of the board, but turns "
            f"back at step {(turns or 0.0) * board.value[1]:.0f}",
        )
        reach = max(abs(self._angle(lowest)), abs(self._angle(1.0)))
        checks.require(
            reach < math.pi / 2,
            f"{name}.gain",
            f"full scale reaches {math.degrees(reach):.6g} deg; a mirror stays below 90 deg "
            f"(unit is {self.unit.name})",
        )

    def _angle(self, u: float) -> float:
        return sum(c * u**k for k, c in enumerate(self.coefficients))

    def _slope(self, u: float) -> float:
        return sum(k * c * u ** (k - 1) for k, c in enumerate(self.coefficients) if k)


@register("laser", "two_mirror")
@dataclass
class TwoMirror:
    """Scanner with an up-down and a left-right mirror whose axes stand `mirror_offset` apart.

    Parameters
    ----------
    mirror_offset : float, m
        Distance between the two axes (Eq 4.3). It is your instrument's own. The dissertation does
        not print it, and the points of Figure 4.28 barely determine it: their best fit is 0.000533
        deg^2 at 0 m, 0.000564 at 0.020 m, 0.000745 at 0.040 m.
    board : Board
        D/A converter that drives both mirrors.
    up_down, left_right : Mirror
        Calibration of each mirror.
    """

    mirror_offset: float = 0.0
    board: Board = Board.bits_12_sign
    up_down: Mirror = field(default_factory=Mirror)
    left_right: Mirror = field(default_factory=Mirror)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.non_negative("mirror_offset", self.mirror_offset)
        for name in MIRRORS:
            getattr(self, name).check(checks, name, self.board)
        checks.done()

    @property
    def step(self) -> NDArray[np.float64]:
        """Angle of one DAC step at step 0, shape (mirror,), rad; always positive."""
        import numpy as np

        largest = self.board.value[1]
        return np.array([abs(getattr(self, m).coefficients[1]) / largest for m in MIRRORS])

    def angle_from_dac(
        self, dac: ArrayLike, labels: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """Mirror angles of DAC steps; see `sldvexp.laser.mirror.angle_from_dac`."""
        from sldvexp.laser import mirror

        return mirror.angle_from_dac(self, dac, labels)

    def dac_from_angle(
        self, angle: ArrayLike, labels: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """DAC steps (not rounded) of mirror angles; see `sldvexp.laser.mirror.dac_from_angle`."""
        from sldvexp.laser import mirror

        return mirror.dac_from_angle(self, angle, labels)
