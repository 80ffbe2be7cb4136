"""What a model put to the test was found to be, in sentences.

A rejected model says nothing against the measurement: its bounds stand, so that all findings about
a model are notes. What rests on the model alone, the expansion of modes, is left out when its
shapes are rejected.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.models.estimate import ExaminedModel
from sldvexp.models.placing import moving
from sldvexp.models.shape_agreement import ShapeTest

#: Share of another mode, in standard errors, from which it is named, and how many are.
NAMED, MOST = 4.0, 2
#: Parameters on which the shapes of a structure of one material and thickness do not depend.
BLIND = ("E", "rho", "thickness")
#: Phase of the motion at the force from which it is told, in standard errors and rad.
TURNED, LARGE = 4.0, 0.05


def findings_about(found: ExaminedModel) -> list[Finding]:
    """Say what was found about a model, its shapes first."""
    return [
        *_about_pairs(found),
        *_about_pixels(found),
        *_about_shapes(found),
        *_about_frequencies(found),
        *_about_parameters(found),
        *_about_masses(found),
        *_about_limits(found),
    ]


def _note(
    kind: str, text: str, statistic: float = np.nan, p_value: float = np.nan, size: float = np.nan
) -> Finding:
    return Finding(kind, "model", f"model: {text}", Severity.note, statistic, p_value, size)


def _about_pairs(found: ExaminedModel) -> Iterator[Finding]:
    """Name measured modes that the model lacks, and poses that count as exact."""
    frequency = found.modes["natural_frequency"].values
    for mode in np.flatnonzero(found.pair < 0):
        best = float(found.mac.value[mode].max())
        yield _note(
            "model_lacks_mode",
            f"measured mode {mode + 1} ({frequency[mode]:.5g} Hz) is none of its modes: "
            f"the best MAC is {best:.3g}",
            size=best,
        )
    exact = [v.pixels.name for v in found.views if v.pixels.covariance is None]
    if exact:
        yield _note(
            "model_exact_poses",
            f"the poses of {', '.join(exact)} have no uncertainty and count as exact: shapes are "
            "rejected too often if they are not",
        )


def _about_pixels(found: ExaminedModel) -> Iterator[Finding]:
    """Count pixels that look past the model, and those of them that move."""
    told = {view.pixels.name: moving(view) for view in found.views}
    count = {name: len(past) for name, (_, past) in told.items()}
    whole = {name: count[name] + len(seen) for name, (seen, _) in told.items()}
    beside, move = sum(count.values()), int(sum(past.sum() for _, past in told.values()))
    if not beside:
        return
    most = max(count, key=lambda name: count[name] / max(whole[name], 1))
    yield _note(
        "model_pixels_beside",
        f"{beside} of {sum(whole.values())} pixels look past it and are left out, "
        f"{f'{move} of them moving' if move else 'all at rest'}; most in view {most}, "
        f"{count[most]} of {whole[most]}",
        size=beside / sum(whole.values()),
    )


def _about_shapes(found: ExaminedModel) -> Iterator[Finding]:
    """Say whether the shapes are those measured, and which of them are not."""
    if not found.shapes_rejected:
        yield _note(
            "model_shapes",
            f"the shapes of {_modes(len(found.tests))} are those measured (chi-square "
            f"{_ratio(found.shapes.chi2, found.shapes.dof)}, "
            f"p = {found.shapes.p_value:.2g}; directed p = {found.shapes.directed_p_value:.2g})",
            statistic=found.shapes.chi2,
            p_value=found.shapes.p_value,
        )
        return
    yield _note(
        "model_shapes_rejected",
        "its shapes are not those measured (chi-square "
        f"{_ratio(found.shapes.chi2, found.shapes.dof)}, p = {found.shapes.p_value:.2g}; "
        f"directed p = {found.shapes.directed_p_value:.2g}), so that modes are not expanded by it",
        statistic=found.shapes.chi2,
        p_value=min(found.shapes.p_value, found.shapes.directed_p_value),
    )
    level = (1 - found.confidence) / (2 * len(found.tests))
    for test in found.tests:
        p_value = min(test.p_value, test.directed_p_value)
        if p_value < level:
            yield _about_shape(found, test, p_value)


def _about_shape(found: ExaminedModel, test: ShapeTest, p_value: float) -> Finding:
    """Say what is in a measured mode beside the model's."""
    frequency = float(found.modes["natural_frequency"].values[test.mode])
    share, std = np.abs(test.mixed), test.mixed_std
    sure = np.where(std > 0, share / np.where(std > 0, std, 1.0), 0.0)
    largest = np.argsort(-share * (sure > NAMED))[:MOST]
    parts = [
        f"{100 * share[j]:.2g} % of its mode {j + 1} ({found.model.frequency[j]:.4g} Hz)"
        for j in largest
        if sure[j] > NAMED
    ]
    within = f", and has {' and '.join(parts)} in it" if parts else ""
    mac = float(found.mac.value[test.mode, test.model_mode])
    return _note(
        "model_shape",
        f"measured mode {test.mode + 1} ({frequency:.5g} Hz) is not its mode "
        f"{test.model_mode + 1}: chi-square {_ratio(test.chi2, test.dof)} at a MAC of "
        f"{mac:.5f}{within}",
        statistic=test.chi2,
        p_value=p_value,
        size=float(share.max()),
    )


def _about_frequencies(found: ExaminedModel) -> Iterator[Finding]:
    """Say whether the frequencies are those measured, as far as that can be told."""
    test = found.frequencies
    if not found.frequencies_judged:
        yield _note(
            "model_frequencies_open",
            f"its frequencies are {100 * test.common:+.3g} % beside those measured, which is not "
            "judged, because nothing is said of how well it is known (model.parameters with a "
            "tolerance, model.discretisation)",
            size=test.common,
        )
        return
    differ = (
        f"{100 * test.common:+.3g} % in common, of which tolerances and mesh explain "
        f"{100 * test.common_std:.2g} % (one standard deviation; p = {test.common_p_value:.2g}), "
        f"all together p = {test.p_value:.2g}"
    )
    if found.frequencies_rejected:
        kind, said = "model_frequencies_rejected", "its frequencies are not those measured"
    else:
        kind, said = "model_frequencies", "its frequencies may be those measured"
    yield _note(
        kind,
        f"{said}: measured are {differ}",
        statistic=test.chi2,
        p_value=min(test.p_value, test.common_p_value),
        size=test.common,
    )


def _about_parameters(found: ExaminedModel) -> Iterator[Finding]:
    """Say what adjusted parameters came out as."""
    updated = found.updated
    if updated is None:
        return
    parts = [
        f"{name} {100 * (factor - 1):+.3g} % +- {100 * std:.2g} %"
        for name, factor, std in zip(updated.names, updated.factor, updated.std, strict=True)
    ]
    left = "" if np.isnan(updated.p_value) else f" (what is left has p = {updated.p_value:.2g})"
    yield _note(
        "model_adjusted",
        f"the frequencies fit with {', '.join(parts)}{left}",
        statistic=updated.chi2,
        p_value=updated.p_value,
    )


def _about_masses(found: ExaminedModel) -> Iterator[Finding]:
    """Say what the modal masses are, and where the force is not as it is said to be."""
    masses = found.masses
    if masses is None:
        return
    frequency = found.modes["natural_frequency"].values[found.paired]
    parts = [
        f"{mass:.4g} +- {std:.2g} kg ({hertz:.4g} Hz)"
        for mass, std, hertz in zip(masses.mass, masses.std, frequency, strict=True)
    ]
    yield _note(
        "model_modal_masses",
        f"modal masses, for shapes that are 1 where it moves most: {', '.join(parts)}",
    )
    phase = np.angle(masses.receptance)
    turned = (np.abs(phase) > TURNED * masses.phase_std) & (np.abs(phase) > LARGE)
    if turned.any():
        some = ", ".join(
            f"{np.degrees(p):+.3g} deg at {hertz:.4g} Hz"
            for p, hertz in zip(phase[turned], frequency[turned], strict=True)
        )
        yield _note(
            "model_force_turned",
            f"the motion where the force acts leads it at resonance by {some}, where it should be "
            "in phase: the force acts elsewhere, along another direction, or not in phase with the "
            "reference, so that these modal masses are in doubt (model.drive)",
            size=float(np.abs(phase).max()),
        )


def _about_limits(found: ExaminedModel) -> Iterator[Finding]:
    """Say what neither shapes nor frequencies could have shown."""
    named = [n for n in BLIND if n in found.known.sensitivity]
    shapes = named or (["thickness"] if found.model.thickness else [])
    seen = [
        f"{name} by less than {100 * least:.2g} %"
        for name, least in found.frequencies.unseen.items()
        if np.isfinite(least)
    ]
    open_masses = found.masses is None and not found.shapes_rejected
    if not shapes and not seen and not open_masses:
        return
    text = ""
    if shapes:
        text = (
            f"its shapes say nothing of {', '.join(shapes)}: those of a thin structure of one "
            "material do not change with them"
        )
    if seen and found.frequencies_judged:
        text += f"{'; ' if text else ''}its frequencies do not tell, in 19 of 20 cases, "
        text += f"{', '.join(seen)} within the other tolerances"
    if open_masses:
        text += f"{'; ' if text else ''}modal masses need " + (
            "the force: where it acts, along which way and how large it is for one unit of the "
            "reference (model.drive)"
            if "reference" in found.modes
            else "the amplitude of the reference, which the images do not say"
        )
    yield _note("model_limits", text)


def _modes(count: int) -> str:
    return f"{count} mode{'s' * (count > 1)}"


def _ratio(chi2: float, dof: int) -> str:
    """Write a chi-square by its degrees of freedom."""
    return f"{chi2 / dof:.3g} times its {dof} degrees of freedom"
