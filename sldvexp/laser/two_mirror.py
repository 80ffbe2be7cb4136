"""`laser=two_mirror`: two galvanometer mirrors with offset, orthogonal axes, and their D/A board."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from sldvexp.errors import Checks
from sldvexp.registry import register

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

MIRRORS = ("up_down", "left_right")


class Board(Enum):
    """D/A converters by their range of steps."""

    bits_12_sign = (-4096, 4096)
    bits_16 = (-32768, 32767)


class AngleUnit(Enum):
    """Units in which a configuration may state angles; the value is one of them in rad."""

    rad = 1.0
    deg = 0.017453292519943295


@dataclass
class Mirror:
    """One mirror's calibration, ``angle = zero + gain u + sum_k polynomial[k] u**(k + 2)``.

    `u` is the DAC step over the board's largest step, so that a calibration holds for any board.

    Parameters
    ----------
    gain : float
        Angle at full scale (u = 1). Negative for a mirror wired the other way round.
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


@register("laser", "two_mirror")
@dataclass
class TwoMirror:
    """Scanner with an up-down and a left-right mirror whose axes stand `mirror_offset` apart.

    Parameters
    ----------
    mirror_offset : float, m
        Distance between the two axes (Eq 4.3).
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
            mirror = getattr(self, name)
            checks.finite(f"{name}.gain", mirror.gain)
            checks.finite(f"{name}.zero", mirror.zero)
            checks.finite(f"{name}.polynomial", *mirror.polynomial)
            checks.require(
                mirror.gain != 0, f"{name}.gain", "must not be zero: the mirror would not move"
            )
        checks.done()

    @property
    def step(self) -> NDArray[np.float64]:
        """Angle of one DAC step at step 0, shape (mirror,), rad; always positive."""
        import numpy as np

        largest = self.board.value[1]
        return np.array([abs(getattr(self, m).coefficients[1]) / largest for m in MIRRORS])

    def angle_from_dac(self, dac: ArrayLike, labels: ArrayLike | None = None) -> NDArray[np.float64]:
        """Mirror angles of DAC steps; see `sldvexp.laser.mirror.angle_from_dac`."""
        from sldvexp.laser import mirror

        return mirror.angle_from_dac(self, dac, labels)

    def dac_from_angle(
        self, angle: ArrayLike, labels: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """DAC steps (not rounded) of mirror angles; see `sldvexp.laser.mirror.dac_from_angle`."""
        from sldvexp.laser import mirror

        return mirror.dac_from_angle(self, angle, labels)
