"""Modes of a run's images: poles, modal images of every view, and what speaks against them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sldvexp import dataset
from sldvexp.dataset import MODAL_IMAGES, Finding
from sldvexp.lazy import xarray as xr
from sldvexp.modes.base import ModalFit, ModalMethod
from sldvexp.modes.collinearity import PhaseSums
from sldvexp.modes.findings import findings_about, inflation
from sldvexp.modes.images import ModalImage, ModalProjection
from sldvexp.modes.quality import LineSums
from sldvexp.modes.responses import Responses
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array

PARTS = ("real", "imaginary")


@dataclass(frozen=True, eq=False)
class ModalEstimate:
    """Modes of a structure and the modal images of all views.

    Parameters
    ----------
    fit : ModalFit
    projection : ModalProjection
    modes : xarray.Dataset
        The group ``modes``.
    images : dict of str to xarray.Dataset
        Groups like ``image/<view>`` with a mode in the place of each line, by the view.
    findings : list of Finding
    """

    fit: ModalFit
    projection: ModalProjection
    modes: xr.Dataset
    images: dict[str, xr.Dataset]
    findings: list[Finding]

    def groups(self) -> dict[str, xr.Dataset]:
        """Name the groups of a run that it makes."""
        named = {f"{MODAL_IMAGES}{view}": image for view, image in self.images.items()}
        return {"modes": self.modes, **named}


def estimate_modes(images: Mapping[str, xr.Dataset], method: ModalMethod) -> ModalEstimate:
    """Find the modes of a structure in velocity images of many lines.

    Parameters
    ----------
    images : mapping of str to xarray.Dataset
        Groups ``image/<view>`` by the name of the view, all with the same lines.
    method : ModalMethod

    Raises
    ------
    UserError
        If the lines differ or are too few, or there is no mode among them.

    Examples
    --------
    A strip that bends at 100 Hz with 1 % of damping, seen by 50 pixels on 60 lines:

    >>> import numpy as np
    >>> from sldvexp import dataset, modes
    >>> rng, line = np.random.default_rng(1), np.linspace(80, 120, 60)
    >>> shape, noise = np.sin(np.linspace(0, 3, 50)), 1e-5
    >>> r = line / 100
    >>> seen = 1e-3 * np.outer(shape, 0.02j * r / (1 - r**2 + 0.02j * r))
    >>> seen = seen + noise * (rng.normal(size=seen.shape) + 1j * rng.normal(size=seen.shape))
    >>> coords = {"pixel": np.arange(50), "frequency": line}
    >>> front = dataset.group(
    ...     "image",
    ...     coords,
    ...     velocity=seen,
    ...     velocity_std=np.full(seen.shape, noise),
    ...     dac=np.zeros((50, 2)),
    ...     flags=np.zeros(50, int),
    ... )
    >>> found = modes.estimate_modes({"front": front}, modes.MostLikelyModes()).modes
    >>> found["natural_frequency"].values.round(2), found["damping_ratio"].values.round(4)
    (array([100.]), array([0.01]))
    """
    responses = Responses.from_images(images, method.lines, method.left_out)
    fit = method.identify(responses)
    p_value = float(chi_square_p_value(fit.chi_square, fit.dof))
    wider = inflation(fit.chi_square / fit.dof, p_value)
    fit = replace(fit, covariance=fit.covariance * wider)
    projection = ModalProjection(
        fit.pole, fit.beyond, responses.frequency, fit.weight, fit.harmonics
    )
    mixing = projection.mixing(fit.covariance)
    found, sums, quality = {}, PhaseSums.empty(len(fit.pole)), LineSums.empty(len(fit.weight))
    for modal in projection.images(responses):
        image = images[modal.view.name]
        used = image["flags"].values == 0
        found[modal.view.name] = _image(modal, image, fit, mixing)
        sums += PhaseSums.of(modal.velocity[used], modal.std[used])
        quality += LineSums.of(modal, used)
    modes = _modes(fit, responses, projection, sums, quality)
    if responses.reference is not None:
        first = next(iter(images.values()))["reference_amplitude"]
        modes["reference"].attrs |= {k: first.attrs[k] for k in ("units",) if k in first.attrs}
    told = list(findings_about(modes, fit.responses))
    return ModalEstimate(fit, projection, modes, found, told)


def _natural(fit: ModalFit) -> tuple[Array, Array]:
    """Return natural frequencies, Hz, and damping ratios."""
    size = np.abs(fit.pole)
    return size / (2 * np.pi), -fit.pole.real / size


def _image(modal: ModalImage, image: xr.Dataset, fit: ModalFit, mixing: Array) -> xr.Dataset:
    """Make the modal image of a view as a group like ``image/<view>``."""
    made = dataset.group(
        "image",
        {"pixel": image["pixel"].values, "frequency": _natural(fit)[0]},
        velocity=modal.velocity,
        velocity_std=modal.std,
        angle=image["angle"].values if "angle" in image else None,
        dac=image["dac"].values,
        flags=image["flags"].values,
        scale_std=np.diag(mixing[0]),
        phase_std=np.diag(mixing[1]),
    )
    made["flags"].attrs |= image["flags"].attrs
    told = {key: image.attrs[key] for key in ("shape", "summary") if key in image.attrs}
    return made.assign_attrs(told)


def _modes(
    fit: ModalFit,
    responses: Responses,
    projection: ModalProjection,
    sums: PhaseSums,
    quality: LineSums,
) -> xr.Dataset:
    """Make the group ``modes``."""
    mixing, changes = projection.mixing(fit.covariance), projection.changes
    natural, damping = _natural(fit)
    count, candidates = len(fit.pole), fit.stabilisation
    relative = np.sqrt(np.diag(fit.covariance))
    scale, scale_std, reference = None, None, None
    if responses.reference is not None:
        reference = responses.nominal
        scale = sums.rms() / responses.nominal
        scale_std = scale * np.hypot(np.diag(mixing[0]), sums.rms_relative_std())
    size = np.abs(candidates.pole)
    parameters = [f"{name}_{k + 1}" for name in ("frequency", "damping") for k in range(count)]
    return dataset.group(
        "modes",
        {
            "mode": np.arange(1, count + 1),
            "part": list(PARTS),
            "mode2": np.arange(1, count + 1),
            "pole_parameter": parameters,
            "pole_parameter2": parameters,
            "line": np.arange(len(responses.frequency)),
            "harmonic": fit.harmonics.order,
            "candidate": np.arange(len(size)),
        },
        natural_frequency=natural,
        natural_frequency_std=natural * relative[:count],
        damping_ratio=damping,
        damping_ratio_std=damping * relative[count:],
        pole_covariance=fit.covariance,
        scale_std=np.diag(mixing[0]),
        phase_std=np.diag(mixing[1]),
        mixing_std=mixing,
        shape_change=np.stack([changes.real, changes.imag]),
        complexity=sums.complexity(),
        complexity_std=sums.complexity_std(),
        phase=sums.phase(),
        reference=reference,
        modal_scale=scale,
        modal_scale_std=scale_std,
        misfit=fit.chi_square / fit.dof,
        misfit_dof=fit.dof,
        misfit_p_value=chi_square_p_value(fit.chi_square, fit.dof),
        misfit_by_line=fit.by_line,
        line_frequency=responses.frequency,
        noise_ratio=fit.noise_ratio,
        measured_rms=quality.rms("measured"),
        synthesis_rms=quality.rms("synthesis"),
        residual_rms=quality.rms("residual"),
        noise_rms=quality.rms("noise"),
        harmonics_rms=quality.rms("harmonics"),
        harmonic_ratio=fit.harmonics.ratio,
        candidate_order=candidates.order,
        candidate_frequency=size / (2 * np.pi),
        candidate_damping=-candidates.pole.real / size,
        candidate_stable=candidates.stable,
        candidate_mode=candidates.mode + 1,
    )
