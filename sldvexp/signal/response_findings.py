r"""Errors of response functions that their standard errors do not hold, told by the records.

**Leakage** of noise that goes on beyond a record. Near a resonance of decay rate
``a = zeta omega_n`` a window w with the autocorrelation r (of 1 at 0) gives, of a true H,
``E Sxy / Sxx = A H`` and ``E Syy / Sxx = A |H|^2`` with

    A = integral of a exp(-a t) r(t) over t from 0 to the record's end T

so that the coherence at the resonance is A, and H is too small by ``1 - A``: it tells the bias
itself. Of Hann's window ``1 - A`` is about ``1 / (3 (T zeta f_n)^2)``. Noise also lowers the
coherence, but no more at resonances than elsewhere; the residual power of the other lines is taken
for noise and subtracted.

**Tails** of bursts and hits that are cut off. The impulse response, that of H, has all that records
have room for: whole up to the lag L from the burst's end to the record's, less and less beyond. Its
late decay is that of the slowest resonance; of a burst of the length B that ends at L before the
record's end, H is there too small by ``exp(-a L) (1 - exp(-a B)) / (a B)``, of a hit by
``exp(-a L)``, and the coherence stays as it is. Noise is the same at all lags, and known.

**Hum** of the mains is at multiples of 50 or 60 Hz and in no phase with the excitation: residual
power of a line there, excited or not, that is far above that of the lines on either side.

**Distortion** shows on lines that are not excited. Noise there is that of the excited lines'
residuals.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.signal.excitation import BEFORE_PULSE, ExcitationKind, RecordDesign
from sldvexp.signal.record_faults import RecordFault
from sldvexp.signal.response_function import LEAST_RECORDS, response_function
from sldvexp.signal.response_sums import ResponseSums
from sldvexp.typing import Array, BoolArray, IndexArray

#: Relative error of a response function that is worth a word.
LEAST_ERROR = 0.01
#: Residual power at a resonance over that of the median line, from which it is no noise, whatever
#: its colour.
ABOVE_NOISE = 1.5
#: Squared response of a resonance over that between it and any higher one, pixels summed.
RESONANT = 4.0
#: Share of a burst's response that may be left at the record's end.
QUIET_ENOUGH = 1e-3
#: Pieces of a record over which the impulse response is averaged, and over how many of the last
#: clear ones its decay is taken.
PIECES, LATE = 20, 6
#: Share of the band that is tapered at either end, so that the response's beginning does not
#: ring on through all lags.
TAPER = 0.1
#: An energy in its standard errors by chance, from which it is none.
CLEAR = 5.0
#: Pixels that are worked on at once, for memory's sake.
PIXELS = 256
#: Errors in standard errors: one that intervals miss, and one that they hold all the same.
HIDDEN, NEGLIGIBLE = 2.0, 0.5
#: Power at unexcited lines over the noise, from which it is distortion. They lie among the excited
#: ones, so that noise of any colour is the same at both.
DISTORTED = 1.1
#: Frequencies of mains, Hz, and residual power at a multiple over that of each neighbour, from
#: which it is hum; near resonances power changes from line to line as well.
MAINS, HUMMING = (50.0, 60.0), 2.0
#: Power of the reference at a line over the median line's, below which there is none.
NO_ENERGY = 1e-4
#: Most lines that a sentence names.
NAMED = 6
#: Share of records left out, from which results are doubtful.
MANY = 0.5


def find_response_findings(
    sums: ResponseSums, design: RecordDesign, view: str, mains: Sequence[float] = MAINS
) -> list[Finding]:
    """Find what is wrong with the response functions of a view.

    Parameters
    ----------
    sums : ResponseSums
        Of its pixels, at `design.read_lines`.
    mains : sequence of float, Hz
        Frequencies of mains whose hum is looked for.

    Examples
    --------
    >>> from sldvexp.signal import Excitation, ResponseSums, find_response_findings
    >>> design = Excitation(band=[100.0, 300.0]).design(rate=1000.0, samples=200)
    >>> sums = ResponseSums.zeros(2, design.frequency)
    >>> x, y = design.spectra([[design.waveform()] * 3] * 2), 1.0
    >>> sums.add(x, y * x, faults=[[0, 0, 8], [0, 0, 0]])
    >>> [finding.text for finding in find_response_findings(sums, design, "left")]
    ['in view left 1 of 6 records are left out (non_finite 1)']
    """
    excited = np.isin(design.read_lines, design.lines)
    found = [*_left_out(sums, view), *_no_energy(sums.at(excited), view)]
    if sums.count.max(initial=0) < 2:
        return found
    kind = design.excitation.kind
    if kind is ExcitationKind.random:
        found += _leakage(sums.at(excited), design, view)
    elif not design.excitation.periodic:
        found += _tail(sums, design, view)
    found += _hum(sums, excited, view, mains)
    if not excited.all():
        found += _distortion(sums, excited, design, view)
    return found


def coherence_at_resonance(products: Array, window: Array) -> Array:
    """Compute A, the coherence and the share of H that leakage leaves at a resonance.

    Parameters
    ----------
    products : ndarray
        ``T zeta f_n`` of records of the length T.
    window : ndarray, shape (sample,)

    Returns
    -------
    ndarray, shape of `products`
    """
    n = len(window)
    spectrum = np.fft.rfft(window, 2 * n)
    r = np.fft.irfft(spectrum.real**2 + spectrum.imag**2)[:n]
    rate = 2 * np.pi * np.asarray(products, float)[..., None]
    decay = np.exp(-rate * np.arange(n) / n)
    # Weights of the sum as of the trapezium rule, so that a rectangle without decay gives 1.
    decay[..., 0] /= 2
    whole = 1 / (2 * np.tanh(rate[..., 0] / (2 * n)))  # of the infinite sum of the same weights
    return np.asarray((decay * (r / r[0])).sum(axis=-1) / whole, float)


def record_for(coherence: Array, design: RecordDesign) -> Array:
    """Compute record lengths, s, that leave `LEAST_ERROR` where one of now leaves a coherence."""
    products = np.geomspace(1e-3, 1e2, 200)
    thinned = design.window[:: max(1, design.samples // 2048)]
    values = coherence_at_resonance(products, thinned)
    now, then = (
        np.interp(wanted, values, np.log(products)) for wanted in (coherence, 1 - LEAST_ERROR)
    )
    return np.asarray(design.record_seconds * np.exp(then - now), float)


def _left_out(sums: ResponseSums, view: str) -> list[Finding]:
    """Count records with faults."""
    counts = {f.name: int(n) for f, n in zip(RecordFault, sums.left_out.sum(axis=0), strict=True)}
    lost = sum(counts.values())
    if not lost:
        return []
    total = lost + int(sums.count.sum())
    kinds = ", ".join(f"{name} {n}" for name, n in counts.items() if n)
    text = f"in view {view} {lost} of {total} records are left out ({kinds})"
    severity = Severity.doubtful if lost > MANY * total else Severity.note
    return [Finding("records", f"view {view}", text, severity, size=lost / total, views=(view,))]


def _no_energy(sums: ResponseSums, view: str) -> list[Finding]:
    """Name excited lines at which the reference has nothing."""
    power = sums.sxx.sum(axis=0)
    silent = power < NO_ENERGY * np.median(power)
    if not silent.any():
        return []
    text = (
        f"in view {view} the reference has no energy at {_named(sums.frequency[silent])}, where "
        "response functions are noise; leave these lines out of the band"
    )
    return [Finding("no_energy", f"view {view}", text, size=float(silent.mean()), views=(view,))]


def _leakage(sums: ResponseSums, design: RecordDesign, view: str) -> list[Finding]:
    """Name resonances at which leakage lowers the coherence, and a record that would do."""
    rest = _residual_power(sums)
    with np.errstate(invalid="ignore", divide="ignore"):
        power = np.nansum(sums.syy / sums.stretches[:, None], axis=0)
        response = np.nansum((np.abs(sums.sxy) / sums.sxx) ** 2, axis=0)
    beyond = _noise_of_lines(sums, design)
    noise = min(float(np.median(rest)), beyond or np.inf)
    error = (rest - noise) / power
    by_chance = CLEAR / np.sqrt(np.maximum(sums.count - 1, 0).sum())
    above = rest > max(ABOVE_NOISE, 1 + by_chance) * noise
    leaks = _resonances(response) & above & (error > LEAST_ERROR)
    if not leaks.any():
        return []
    scatter = np.sqrt(rest / power / (2 * np.median(sums.averages)))
    worst = float(error[leaks].max())
    severity = _weight(float((error / scatter)[leaks].max()))
    seconds = float(record_for(1 - error[leaks], design).max())
    text = (
        f"in view {view} records of {design.record_seconds:.3g} s leak at "
        f"{_named(sums.frequency[leaks])}: noise apart, the coherence at these is as low as "
        f"{1 - worst:.2f}, so that response functions are up to {100 * worst:.0f} % too small and "
        f"standard errors do not say so; take records of {seconds:.2g} s or a periodic excitation"
    )
    return [Finding("leakage", f"view {view}", text, severity, size=worst, views=(view,))]


def _tail(sums: ResponseSums, design: RecordDesign, view: str) -> list[Finding]:
    """Tell whether the response has died at the record's end, and how long that would take."""
    energy, noise, response = _impulse_energy(sums)
    burst = design.excitation.burst * design.record_seconds
    if design.excitation.kind is ExcitationKind.hammer:
        burst = 2 * BEFORE_PULSE * design.record_seconds
    rate = _late_decay(energy, noise, int((sums.count >= LEAST_RECORDS).sum()), burst, design)
    seconds = design.record_seconds
    lag = seconds - burst
    left = np.exp(-rate * lag)
    if design.excitation.kind is ExcitationKind.burst_random:
        left *= -np.expm1(-rate * burst) / (rate * burst)
    if not left > QUIET_ENOUGH:
        return []
    found = response_function(sums.at(_resonances(response)))
    scatter = float(np.nanmedian(found.std / np.abs(found.response)))
    wanted = seconds * np.log(1 / QUIET_ENOUGH) / rate / lag
    text = (
        f"in view {view} the response has not died at the end of records of {seconds:.3g} s, which "
        f"cuts it off: at the slowest resonance response functions are about {100 * left:.2g} % "
        f"too small, and standard errors do not say so; take records of {wanted:.2g} s, or a "
        "shorter burst"
    )
    severity = _weight(float(left) / scatter)
    return [Finding("tail", f"view {view}", text, severity, size=float(left), views=(view,))]


def _late_decay(
    energy: Array, noise: float, pixels: int, burst: float, design: RecordDesign
) -> float:
    """Find the rate a, 1/s, at which the impulse response dies at last; infinite if none is seen.

    Parameters
    ----------
    energy : ndarray, shape (lag,)
    noise : float
        Part of noise in each.
    burst : float, s
    """
    pieces = np.array_split(energy, PIECES)[:-2]  # the last ones are what rings before zero
    lags = (np.arange(len(pieces)) + 0.5) / PIECES * design.record_seconds
    level = np.array([np.mean(piece) for piece in pieces]) - noise
    clear = level > CLEAR * noise / np.sqrt(max(1, pixels) * len(energy) / PIECES)
    count = len(clear) if clear.all() else int(np.argmin(clear))
    if count < 2:
        return np.inf
    if design.excitation.kind is ExcitationKind.burst_random:
        # Records have room for a lag of only a part of the burst.
        level /= np.minimum((design.record_seconds - lags) / burst, 1.0) ** 2
    first = max(0, count - 1 - LATE)
    fall = np.log(level[first] / level[count - 1]) / (lags[count - 1] - lags[first])
    return float(max(fall / 2, 1 / design.record_seconds))


def _impulse_energy(sums: ResponseSums) -> tuple[Array, float, Array]:
    """Sum over pixels: squared impulse response by lag, its part of noise, ``|H|^2`` by line."""
    lines = len(sums.frequency)
    inside = np.minimum(np.arange(lines), np.arange(lines)[::-1]) + 0.5
    taper = 0.5 - 0.5 * np.cos(np.pi * np.minimum(inside / (TAPER * lines), 1.0))
    energy, noise, response = np.zeros(lines), 0.0, np.zeros(lines)
    for first in range(0, len(sums.count), PIXELS):
        found = response_function(sums.of_pixels(slice(first, first + PIXELS)))
        good = found.records >= LEAST_RECORDS
        h = found.response[good]
        impulse = np.fft.ifft(h * taper, axis=1) * lines
        energy += (impulse.real**2 + impulse.imag**2).sum(axis=0)
        noise += float(np.sum(2 * (found.std[good] * taper) ** 2))
        response += (h.real**2 + h.imag**2).sum(axis=0)
    return energy, noise, response


def _hum(
    sums: ResponseSums, excited: BoolArray, view: str, mains: Sequence[float]
) -> list[Finding]:
    """Name lines at multiples of a mains frequency that have more noise than their neighbours."""
    with np.errstate(invalid="ignore", divide="ignore"):
        power = np.nansum(sums.syy / sums.stretches[:, None], axis=0)
        response = np.nansum((np.abs(sums.sxy) / sums.sxx) ** 2, axis=0)
    noise = np.where(excited, _residual_power(sums), power)
    by_chance = CLEAR / np.sqrt(max(1, np.maximum(sums.count - 1, 0).sum()))
    above = max(HUMMING, 1 + by_chance * np.sqrt(2))  # a ratio of two scattered powers
    beside = np.full(len(noise), np.inf)
    beside[1:-1] = np.maximum(noise[:-2], noise[2:])
    stands_out = noise > above * beside
    resonant = np.zeros(len(noise))
    resonant[excited] = _resonances(response[excited])
    stands_out &= np.convolve(resonant, np.ones(3), "same") == 0
    frequency, spacing = sums.frequency, float(np.diff(sums.frequency).min(initial=np.inf))
    found = []
    for hertz in mains:
        multiple = np.rint(frequency / hertz)
        at = (np.abs(frequency - multiple * hertz) <= spacing / 2) & (multiple >= 1)
        if (hums := stands_out & at).any():
            found.append((hertz, hums))
    if not found:
        return []
    hertz, hums = max(found, key=lambda each: int(each[1].sum()))
    worst = float((noise / beside)[hums].max())
    text = (
        f"in view {view} mains of {hertz:g} Hz hum at {_named(frequency[hums])}, with up to "
        f"{worst:.2g} times the noise of the lines beside; standard errors of excited lines hold "
        "it as long as records begin at any phase of it"
    )
    leave = ",".join(f"{f:g}" for f in frequency[hums & excited])
    remedy = f"modal.leave_out=[{leave}]" if leave else ""
    return [
        Finding(
            "hum", f"view {view}", text, Severity.note, remedy=remedy, size=worst, views=(view,)
        )
    ]


def _distortion(
    sums: ResponseSums, excited: BoolArray, design: RecordDesign, view: str
) -> list[Finding]:
    """Tell how much of the response is at lines that are not excited."""
    noise = float(np.median(_residual_power(sums.at(excited))))
    with np.errstate(invalid="ignore", divide="ignore"):
        power = np.nansum(sums.syy / sums.count[:, None], axis=0)
    lines = design.read_lines
    kinds: dict[str, IndexArray] = {
        "even": np.flatnonzero(~excited & (lines % 2 == 0)),
        "odd": np.flatnonzero(~excited & (lines % 2 == 1)),
    }
    # Hum is at few lines and moves no median; of an exponential distribution it is ln 2 of the
    # mean, of the sum over many pixels the mean itself, and so it is at most too small.
    level = {k: float(np.median(power[at])) for k, at in kinds.items() if len(at)}
    least = {
        k: CLEAR * np.sqrt(np.pi / 2 / max(1, sums.count.sum()) / len(kinds[k])) for k in level
    }
    told = {k: v for k, v in level.items() if v > max(DISTORTED, 1 + least[k]) * noise}
    if not told:
        return []
    linear = float(np.mean(power[excited]))
    share = {k: float(np.sqrt((v - noise) / linear)) for k, v in told.items()}
    parts = " and ".join(f"{100 * v:.2g} % at {k} ones" for k, v in share.items())
    worst = max(share.values())
    bound = np.sqrt(noise / (2 * np.median(sums.count)) / linear)
    text = (
        f"in view {view} the response has lines that are not excited, {parts} (r.m.s., of an "
        "excited line): structure or exciter are not linear at this amplitude, and excited lines "
        "have as much of it; excite less"
    )
    severity = _weight(worst / bound)
    return [Finding("distortion", f"view {view}", text, severity, size=worst, views=(view,))]


def _weight(error: float) -> Severity:
    """Weigh an error that is given in standard errors, which do not hold it."""
    if error > HIDDEN:
        return Severity.void
    return Severity.doubtful if error > NEGLIGIBLE else Severity.note


def _residual_power(sums: ResponseSums) -> Array:
    """Estimate the power of a record that is not the reference's, pixels summed, shape (line,)."""
    # Of n records n - 1; of overlapping ones as many as there are, less what the fit takes.
    worth = np.maximum(sums.averages, 2.0)
    more = np.maximum(sums.stretches * (1 - 1 / worth), 1)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        rest = sums.syy - (sums.sxy.real**2 + sums.sxy.imag**2) / sums.sxx
    return np.asarray(np.nansum(np.maximum(rest, 0) / more, axis=0), float)


def _noise_of_lines(sums: ResponseSums, design: RecordDesign) -> float:
    """Compute the power that the noise beyond the band would have at a line, pixels summed."""
    per_sample = sums.noise / np.maximum(sums.count, 1)
    window = design.window
    return float(np.nansum(per_sample) * 4 * (window**2).sum() / window.sum() ** 2)


def _resonances(response: Array) -> BoolArray:
    """Find maxima that stand out from the lowest line towards whatever is higher, shape (line,)."""
    found = np.zeros(len(response), bool)
    inner = np.flatnonzero((response[1:-1] >= response[:-2]) & (response[1:-1] > response[2:])) + 1
    for k in inner:
        saddles = []
        for side in (response[:k][::-1], response[k + 1 :]):
            higher = np.flatnonzero(side > response[k])
            saddles.append(side[: higher[0] + 1 if len(higher) else None].min())
        found[k] = response[k] > RESONANT * max(saddles)
    return found


def _named(frequency: Array) -> str:
    """Name some lines."""
    named = ", ".join(f"{f:.4g}" for f in frequency[:NAMED])
    more = len(frequency) - NAMED
    return f"{named} Hz" + (f" and {more} others" if more > 0 else "")
