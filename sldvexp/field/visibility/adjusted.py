"""The laser as the solution of a pose has adjusted it."""

from __future__ import annotations

from dataclasses import replace

from sldvexp.errors import ConfigError, UserError
from sldvexp.laser.two_mirror import MIRRORS, Mirror, TwoMirror
from sldvexp.typing import Array
from sldvexp.units import AngleUnit


def adjusted(laser: TwoMirror, intrinsics: Array, where: str) -> TwoMirror:
    """A laser whose true angles are ``gain recorded + zero``, and with another mirror offset.

    Parameters
    ----------
    laser : TwoMirror
        Whose calibration gives the recorded angles.
    intrinsics : ndarray, shape (5,)
        In the order of `sldvexp.pose.least_squares.INTRINSICS`.
    where : str
        Whose intrinsics they are, for the message.

    Raises
    ------
    UserError
        If there is no such laser.
    """
    offset, *others = (float(value) for value in intrinsics)
    gains, zeros = others[::2], others[1::2]
    mirrors = []
    for name, gain, zero in zip(MIRRORS, gains, zeros, strict=True):
        constant, slope, *higher = (gain * c for c in getattr(laser, name).coefficients)
        mirrors.append(Mirror(slope, constant + zero, higher, AngleUnit.rad))
    up_down, left_right = mirrors
    try:
        found = replace(laser, mirror_offset=0.0, up_down=up_down, left_right=left_right)
    except ConfigError as error:
        raise UserError(
            f"{where}: the pose was solved with a laser that there is none of ({error}); give the "
            "adjusted intrinsics what is known of them beforehand, as in "
            "pose.adjust={gain_up_down: 0.002}"
        ) from None
    # An estimate may err below zero, which no configured offset is, and the equations hold there.
    found.mirror_offset = offset
    return found
