"""Findings about modes: lines that the model does not fit, and what a set of lines cannot tell.

What is left over of the principal responses has the variance of the noise if the structure is
linear, all modes are found and the noise is as stated. A few per cent more are seen, for there are
thousands of degrees of freedom. Harmonics of strong lines that fall on others are the usual cause;
where their ratios are found, they are allowed for and said.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array

#: Level of the test of all lines together; a clean run fails it once in a thousand.
LEVEL = 1e-3
#: Variance over that of the noise up to which wider bounds are taken to be enough.
REPAIRABLE = 2.0
#: Difference between found and stated noise that is worth a word, relative.
NOISE_OFF = 0.05
#: Lines that a finding names at most, and orders of harmonics that it looks for.
NAMED, HARMONICS = 6, (2, 3, 4, 5)
#: How much stronger a line is whose harmonic is seen.
STRONGER = 3.0
#: Ratio of a harmonic beyond which the structure itself may not be linear, and with it its modes.
NOT_LINEAR = 0.01
#: Share of a neighbour in a mode's shape that is worth a word.
MIXED = 0.02


def inflation(misfit: float, p_value: float) -> float:
    """Return the factor of the covariance of poles: the misfit where its test fails, else 1.

    Examples
    --------
    >>> inflation(1.4, 1e-40), inflation(1.02, 0.3)
    (1.4, 1.0)
    """
    return misfit if p_value < LEVEL and misfit > 1 else 1.0


def findings_about(modes: xr.Dataset, responses: int) -> Iterator[Finding]:
    """Judge the group ``modes``.

    Parameters
    ----------
    modes : xarray.Dataset
    responses : int
        How many principal responses there were.
    """
    yield from _harmonics(modes)
    yield from _misfit(modes, responses)
    yield from _noise(modes)
    yield from _close(modes)
    yield from _coarse(modes)


def _misfit(modes: xr.Dataset, responses: int) -> Iterator[Finding]:
    """Say that lines are not those of linear modes, which ones and what to do."""
    misfit, p_value = float(modes["misfit"]), float(modes["misfit_p_value"])
    if inflation(misfit, p_value) == 1:
        return
    line, found = modes["line_frequency"].values, modes["misfit_by_line"].values
    worst = _worst_lines(found, responses)
    told = [_named(k, modes) for k in worst[:NAMED]]
    harmonics = sum(" x " in name for name in told) > len(told) / 2
    where = f", most at {', '.join(told)} Hz" if told else ""
    cause = (
        "these are harmonics of strong lines, of the instrument or of a structure that is not "
        "linear"
        if harmonics
        else "a mode may be missed or lie beyond the band, or the structure is not linear"
    )
    remedy = f"modal.leave_out=[{','.join(f'{f:g}' for f in np.sort(line[worst]))}]"
    advice = (
        "leave them out, or excite odd multiples of a spacing, on which no even harmonics fall"
        if harmonics
        else "look at the residual of the synthesis, and choose another modal.band"
    )
    yield Finding(
        "misfit",
        "modes",
        f"what the modes leave over has {misfit:.2f} times the variance of the noise{where}: "
        f"{cause}; bounds of poles are {np.sqrt(misfit):.2f} times wider for it; {advice}",
        Severity.note if misfit < REPAIRABLE else Severity.doubtful,
        misfit,
        p_value,
        float(np.sqrt(misfit)),
        remedy if harmonics else "",
    )


def _harmonics(modes: xr.Dataset) -> Iterator[Finding]:
    """Say which harmonics fall on lines, where most, and what was done about them."""
    ratio, order = modes["harmonic_ratio"].values, modes["harmonic"].values
    if not len(order):
        return
    worst = np.argsort(-(modes["harmonics_rms"] / modes["noise_rms"]).values, kind="stable")
    told = ", ".join(f"{n:.0f} f: {r:.2g} %" for n, r in zip(order, 100 * ratio, strict=True))
    named = ", ".join(_named(k, modes) for k in worst[:NAMED])
    strong = bool(ratio.max() > NOT_LINEAR)
    which = (
        "a structure that is not linear has modes that depend on the excitation: compare with a "
        "weaker one"
        if strong
        else "bounds hold it; excite odd multiples of a spacing, on which no even harmonics fall, "
        "to be rid of most"
    )
    yield Finding(
        "harmonics",
        "modes",
        f"harmonics of lines ({told} of them) fall on others, most at {named} Hz: these lines "
        f"count for less; {which}",
        Severity.doubtful if strong else Severity.note,
        size=float(ratio.max()),
    )


def _worst_lines(misfit: Array, responses: int) -> Array:
    """Find lines whose misfit is no chance among so many, the worst first."""
    dof = 2 * responses
    p_value = scipy.special.chdtrc(dof, dof * misfit)
    order = np.argsort(-misfit, kind="stable")
    return order[p_value[order] < LEVEL / len(misfit)]


def _named(worst: int, modes: xr.Dataset) -> str:
    """Name a line, as a multiple of a stronger one if there is such a line."""
    line, rms = modes["line_frequency"].values, modes["measured_rms"].values
    for order in HARMONICS:
        source = int(np.abs(line - line[worst] / order).argmin())
        same = abs(line[source] * order - line[worst]) < 1e-6 * line[worst]
        if same and rms[source] > STRONGER * rms[worst]:
            return f"{line[worst]:g} ({order} x {line[source]:g})"
    return f"{line[worst]:g}"


def _noise(modes: xr.Dataset) -> Iterator[Finding]:
    """Say that noise is not what was stated."""
    ratio = float(modes["noise_ratio"])
    if abs(ratio - 1) < NOISE_OFF:
        return
    more = ratio > 1
    consequence = (
        "bounds of poles and of modal images are made wider by it"
        if more
        else "bounds are left as the stated noise makes them"
    )
    yield Finding(
        "noise",
        "modes",
        f"noise beside the modes is {ratio:.3g} times the stated one: {consequence}",
        Severity.note,
        ratio,
        size=ratio,
    )


def _close(modes: xr.Dataset) -> Iterator[Finding]:
    """Say which modes are so close that their shapes are known only as a mixture."""
    mixing, natural = modes["mixing_std"].values.max(axis=0), modes["natural_frequency"].values
    for first, second in zip(range(len(natural) - 1), range(1, len(natural)), strict=True):
        share = max(mixing[first, second], mixing[second, first])
        if share > MIXED:
            yield Finding(
                "close_modes",
                f"modes {first + 1} and {second + 1}",
                f"the modes at {natural[first]:.5g} and {natural[second]:.5g} Hz are so close that "
                f"a share of {share:.0%} (standard error) of one may be in the other's shape; "
                "finer lines, or a second place of excitation, would part them",
                Severity.note,
                size=float(share),
            )


def _coarse(modes: xr.Dataset) -> Iterator[Finding]:
    """Say which resonances are narrower than half of what the lines are apart."""
    line, natural = modes["line_frequency"].values, modes["natural_frequency"].values
    width = 2 * modes["damping_ratio"].values * natural
    at = np.clip(np.searchsorted(line, natural), 1, len(line) - 1)
    narrow = np.flatnonzero(2 * width < line[at] - line[at - 1])
    if len(narrow):
        named = ", ".join(f"{natural[k]:.5g}" for k in narrow[:NAMED])
        yield Finding(
            "coarse_lines",
            "modes",
            f"lines are more than twice as far apart as the resonances at {named} Hz are wide: "
            "damping rests on one or two lines, and on records in which such a resonance has "
            "settled",
            Severity.note,
            size=float((width / (line[at] - line[at - 1]))[narrow].min()),
        )
