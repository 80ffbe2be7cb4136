"""Finds the pixels that are not to be trusted; `sldvexp.signal.pixel_quality.Flag` says what each
means.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.errors import UserError
from sldvexp.signal.channel import ChannelFit, squared
from sldvexp.signal.pixel_quality import Flag, FlagRules
from sldvexp.signal.projection import Projection
from sldvexp.typing import Array, BoolArray

#: A residual below this share of the image's largest sine is arithmetic, not a dead channel.
NOISE_FLOOR = 1e-6


def find_flags(
    velocity: ChannelFit,
    reference: ChannelFit,
    sums: Projection,
    quality: ArrayLike | None,
    rules: FlagRules,
) -> NDArray[np.uint8]:
    """Flags of every pixel.

    Parameters
    ----------
    velocity, reference : ChannelFit
        The reference in V.
    sums : Projection
        Of both channels.
    quality : array_like of bool, shape (pixel,), optional
        False where the instrument reported a lost signal.
    rules : FlagRules

    Returns
    -------
    ndarray of int, shape (pixel,)

    Raises
    ------
    UserError
        If `quality` does not have one entry a pixel.
    """
    non_finite = np.any(~np.isfinite(sums.square), axis=0)
    saturated = np.any(sums.at_limit, axis=0)
    least = np.maximum(rules.poor_fit * _sine_rms(reference), rules.reference_minimum)
    found = {
        Flag.saturated: saturated,
        Flag.dropped_out: _dropped_out(velocity, ~(non_finite | saturated), rules),
        Flag.reference_missing: _reference_missing(reference, rules) & ~non_finite,
        Flag.non_finite: non_finite,
        Flag.poor_fit: reference.noise > least,
    }
    if quality is not None:
        good = np.asarray(quality, bool)
        if good.shape != non_finite.shape:
            raise UserError(
                f"signal: the instrument's quality has the shape {good.shape}, but there are "
                f"{non_finite.size} pixels; give one value for each"
            )
        found[Flag.dropped_out] |= ~good
    flags = np.zeros(non_finite.shape, np.uint8)
    for flag, where in found.items():
        flags |= np.where(where, np.uint8(flag), np.uint8(0))
    return flags


def _dropped_out(velocity: ChannelFit, usable: BoolArray, rules: FlagRules) -> BoolArray:
    """Pixels whose residual stands out from the usable ones' median, either way."""
    if not usable.any():
        return np.zeros(usable.shape, bool)
    floor = NOISE_FLOOR * _sine_rms(velocity)[usable].max()
    noise = np.maximum(velocity.noise, floor)
    typical = np.median(noise[usable])
    return (noise > rules.dropout_factor * typical) | (noise * rules.dropout_factor < typical)


def _reference_missing(reference: ChannelFit, rules: FlagRules) -> BoolArray:
    """Pixels whose reference is too small or too noisy to give a phase at every frequency."""
    least = np.maximum(rules.reference_minimum**2, rules.reference_snr**2 * reference.variance / 2)
    return np.any(~(squared(reference.phasor) >= least), axis=1)


def _sine_rms(fit: ChannelFit) -> Array:
    """Root mean square of the fitted sines, shape (pixel,)."""
    return np.sqrt(squared(fit.phasor).sum(axis=1) / 2)
