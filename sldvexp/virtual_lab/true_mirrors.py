"""How the true mirrors differ from the calibration that the program was given."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import zip_longest

from sldvexp.errors import Checks, ConfigError, UserError
from sldvexp.laser.two_mirror import MIRRORS, Mirror, TwoMirror
from sldvexp.units import AngleUnit


@dataclass
class MirrorError:
    """True calibration minus nominal one, of one mirror.

    Parameters
    ----------
    gain : float
        Relative, of the gain and of all powers; -2 is a mirror wired the other way round.
    zero : float, rad
    polynomial : list of float, rad
        Added to the coefficients of u^2, u^3 and so on.
    """

    gain: float = 0.0
    zero: float = 0.0
    polynomial: list[float] = field(default_factory=list)

    def applied(self, nominal: Mirror) -> Mirror:
        """The true mirror."""
        zero, gain, *powers = nominal.coefficients
        scale = 1.0 + self.gain
        polynomial = [
            scale * known + more
            for known, more in zip_longest(powers, self.polynomial, fillvalue=0.0)
        ]
        return Mirror(scale * gain, zero + self.zero, polynomial, AngleUnit.rad)


@dataclass
class MirrorErrors:
    """True mirrors minus nominal ones, all zero for a perfect calibration.

    Parameters
    ----------
    mirror_offset : float, m
        Added to the distance between the two axes.
    up_down, left_right : MirrorError
    swapped : bool
        The cables from the D/A board to the two mirrors are crossed.
    """

    mirror_offset: float = 0.0
    up_down: MirrorError = field(default_factory=MirrorError)
    left_right: MirrorError = field(default_factory=MirrorError)
    swapped: bool = False

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is no number."""
        checks.finite(f"{name}.mirror_offset", self.mirror_offset)
        for mirror in MIRRORS:
            error = getattr(self, mirror)
            for key in ("gain", "zero"):
                checks.finite(f"{name}.{mirror}.{key}", getattr(error, key))
            checks.finite(f"{name}.{mirror}.polynomial", *error.polynomial)

    def applied(self, nominal: TwoMirror) -> TwoMirror:
        """The true mirrors; UserError if there can be no such mirrors."""
        try:
            return TwoMirror(
                mirror_offset=nominal.mirror_offset + self.mirror_offset,
                board=nominal.board,
                up_down=self.up_down.applied(nominal.up_down),
                left_right=self.left_right.applied(nominal.left_right),
            )
        except ConfigError as error:
            raise UserError(f"scene.mirrors makes true mirrors that cannot be: {error}") from None
