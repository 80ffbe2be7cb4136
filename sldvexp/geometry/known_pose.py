"""A pose as a configuration states it."""

from __future__ import annotations

from dataclasses import dataclass, field

from sldvexp.units import LengthUnit


@dataclass
class KnownPose:
    """One view's pose as numbers.

    Parameters
    ----------
    euler : list of float, rad
        phi1, phi2, phi3 in the x-convention, world to laser.
    origin : list of float
        x, y, z of the laser frame's origin in the world.
    euler_std, origin_std : list of float
        Standard deviations; empty if unknown.
    samples : int
        With samples, the deviations are those of a sample of that size and the pose is its mean;
        with 0 they are the standard errors of the pose itself, exactly known.
    unit : LengthUnit
        Of origin and origin_std.
    """

    euler: list[float] = field(default_factory=list)
    origin: list[float] = field(default_factory=list)
    euler_std: list[float] = field(default_factory=list)
    origin_std: list[float] = field(default_factory=list)
    samples: int = 0
    unit: LengthUnit = LengthUnit.m
