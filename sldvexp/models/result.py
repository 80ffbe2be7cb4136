"""Groups of a run that a model put to the test leaves: ``model``, its shapes, and its pixels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sldvexp import dataset
from sldvexp.lazy import xarray as xr
from sldvexp.models.assurance import Assurance, assurance
from sldvexp.models.estimate import ExaminedModel
from sldvexp.models.expansion import expand
from sldvexp.models.responses import comac, respond, scaled
from sldvexp.models.seen_surface import SeenSurface
from sldvexp.typing import Array, ComplexArray

#: Names of the groups of a view's pixels begin so, as ``model/image/front``.
MODEL_IMAGES = "model/image/"


def model_to_datasets(
    found: ExaminedModel, images: Mapping[str, xr.Dataset]
) -> dict[str, xr.Dataset]:
    """Make the groups of a model put to the test, by their names.

    Parameters
    ----------
    images : mapping of str to xarray.Dataset
        Groups ``image/<view>`` by the view; those of one line are of no use.
    """
    lines = _measured_lines(found, images)
    pixels = {
        f"{MODEL_IMAGES}{view.pixels.name}": _of_view(found, k, lines)
        for k, view in enumerate(found.views)
    }
    return {"model": _of_model(found, lines), "model/shape": _of_nodes(found), **pixels}


class _Lines:
    """Measured lines of the pixels that see the model, view by view, and the model's response."""

    def __init__(self, found: ExaminedModel, images: list[xr.Dataset]):
        self.frequency = np.asarray(images[0]["frequency"].values, float)
        damping = found.modes["damping_ratio"].values[found.paired]
        natural = found.data.computed
        self.measured: list[ComplexArray] = []
        self.std: list[Array] = []
        self.predicted: list[ComplexArray] = []
        for view, image in zip(found.views, images, strict=True):
            own = view.pixels.pixel
            velocity = np.asarray(image["velocity"].values[own], complex)
            std = np.asarray(image["velocity_std"].values[own], float)
            self.measured.append(velocity)
            self.std.append(np.broadcast_to(std.reshape(len(own), -1), velocity.shape))
            shape = scaled(view.shape, found.tests)
            self.predicted.append(respond(shape, natural, damping, self.frequency))

    def by_pixel(self, view: int) -> Assurance:
        """Compute FRAC of a view's pixels."""
        variance = 2 * self.std[view] ** 2
        return assurance(self.measured[view], self.predicted[view], variance)

    def by_line(self) -> Assurance:
        """Compute CSAC of all lines."""
        measured, predicted, std = (
            np.concatenate(one).T for one in (self.measured, self.predicted, self.std)
        )
        return assurance(measured, predicted, 2 * std**2)


def _measured_lines(found: ExaminedModel, images: Mapping[str, xr.Dataset]) -> _Lines | None:
    """Collect the lines of the views; None if they have fewer than two."""
    own = [images.get(view.pixels.name) for view in found.views]
    known = [image for image in own if image is not None and image.sizes.get("frequency", 0) > 1]
    return _Lines(found, known) if len(known) == len(own) else None


def _of_model(found: ExaminedModel, lines: _Lines | None) -> xr.Dataset:
    """Make the group ``model``."""
    modes, known, updated = found.modes, found.known, found.updated
    names = list(known.sensitivity)
    by_line = None if lines is None else lines.by_line()
    coords = {
        "mode": modes["mode"].values,
        "model_mode": np.arange(1, found.model.modes + 1),
        "parameter": np.array(names, dtype=str),
    }
    if updated is not None:
        coords |= {k: np.array(updated.names, dtype=str) for k in ("adjusted", "adjusted2")}
    if by_line is not None and lines is not None:
        coords["line"] = np.arange(len(lines.frequency))
    made = dataset.group(
        "model",
        coords,
        pair=found.pair + 1,
        measured_frequency=modes["natural_frequency"].values,
        measured_frequency_std=modes["natural_frequency_std"].values,
        model_frequency=known.computed,
        model_frequency_std=known.std,
        difference=_at_modes(found, found.data.difference),
        mac=found.mac.value,
        **_of_tests(found),
        shapes_p_value=found.shapes.p_value,
        shapes_directed_p_value=found.shapes.directed_p_value,
        frequencies_chi2=found.frequencies.chi2,
        frequencies_p_value=found.frequencies.p_value,
        common_difference=found.frequencies.common,
        common_difference_std=found.frequencies.common_std,
        common_p_value=found.frequencies.common_p_value,
        sensitivity=np.stack(list(known.sensitivity.values()), axis=-1) if names else None,
        tolerance=[known.tolerance[n] for n in names] if names else None,
        unseen=[found.frequencies.unseen[n] for n in names] if names else None,
        **(_of_parameters(found) if updated is not None else {}),
        **_of_masses(found),
        **({} if lines is None else {"line_frequency": lines.frequency}),
        **({} if by_line is None else _named("csac", by_line)),
    )
    return made.assign_attrs(
        source=found.model.source,
        shapes="rejected" if found.shapes_rejected else "accepted",
        frequencies=found.frequency_verdict,
        thickness=found.model.thickness,
    )


def _named(name: str, criterion: Assurance) -> dict[str, Array]:
    """Name a criterion's three arrays."""
    return {
        name: criterion.value,
        f"{name}_expected": criterion.expected,
        f"{name}_std": criterion.std,
    }


def _at_modes(found: ExaminedModel, values: Array) -> Array:
    """Put values of pairs at their measured modes, NaN at the others."""
    whole = np.full((len(found.pair), *np.shape(values)[1:]), np.nan, np.asarray(values).dtype)
    whole[found.paired] = values
    return whole


def _of_tests(found: ExaminedModel) -> dict[str, Array]:
    """Collect what the shape tests say, mode by mode."""
    tests = found.tests
    # With poses that are not exact the squares are more than the noise's: 2 (n - 1) + tr A.
    size = np.array(
        [
            np.sum(np.abs(found.pixels.measured[:, t.mode] / found.pixels.std[:, t.mode]) ** 2)
            for t in tests
        ]
    )
    spread = np.array([t.own.squares.spread(t.dof) for t in tests])
    scale = np.array([t.scale for t in tests])
    own = {
        "mac_of_pair": np.array([found.mac.value[t.mode, t.model_mode] for t in tests]),
        "mac_expected": 1 - spread[:, 0] / size,
        "mac_std": spread[:, 1] / size,
        "scale": scale,
        "scale_std": np.array([t.scale_std for t in tests]),
        "imaginary_share": scale.imag / np.abs(scale),
        "chi2": np.array([t.chi2 for t in tests]),
        "dof": np.array([float(t.dof) for t in tests]),
        "p_value": np.array([t.p_value for t in tests]),
        "directed_chi2": np.array([t.directed for t in tests]),
        "directed_dof": np.array([float(t.directed_dof) for t in tests]),
        "directed_p_value": np.array([t.directed_p_value for t in tests]),
        "mixed": np.stack([t.mixed for t in tests]),
        "mixed_std": np.stack([t.mixed_std for t in tests]),
    }
    return {name: _at_modes(found, values) for name, values in own.items()}


def _of_parameters(found: ExaminedModel) -> dict[str, Array]:
    """Collect the adjusted parameters."""
    updated = found.updated
    assert updated is not None
    value = np.array([found.known.value[name] for name in updated.names]) * updated.factor
    return {
        "factor": updated.factor,
        "factor_std": updated.std,
        "factor_covariance": updated.covariance,
        "adjusted_value": value,
        "adjusted_value_std": value * updated.std,
        "adjusted_p_value": np.asarray(updated.p_value),
    }


def _of_masses(found: ExaminedModel) -> dict[str, Array]:
    """Collect modal masses, if the force is known."""
    if found.masses is None:
        return {}
    own = {"modal_mass": found.masses.mass, "modal_mass_std": found.masses.std}
    return {name: _at_modes(found, values) for name, values in own.items()}


def _of_nodes(found: ExaminedModel) -> xr.Dataset:
    """Make the group ``model/shape``; modes are expanded unless the shapes are rejected."""
    model = found.model
    side = 1 if sum(view.side for view in found.views) >= 0 else -1
    surface = SeenSurface(model, side * model.thickness / 2)
    velocity = std = None
    if not found.shapes_rejected:
        velocity, std = expand(surface.motion, found.tests)
    return dataset.group(
        "model/shape",
        {
            "node": np.arange(len(surface.position)),
            # Names of their own: groups below another cannot have its dimensions in part.
            "shape_mode": np.arange(1, model.modes + 1),
            "paired_mode": found.modes["mode"].values[found.paired],
        },
        position=surface.position,
        triangle=model.halves,
        shape=surface.motion,
        velocity=velocity,
        velocity_std=std,
    )


def _of_view(found: ExaminedModel, k: int, lines: _Lines | None) -> xr.Dataset:
    """Make the group of the pixels of one view that see the model."""
    view = found.views[k]
    predicted = scaled(view.shape, found.tests)
    measured = view.pixels.velocity[:, found.paired]
    criterion = comac(measured, predicted, view.pixels.std[:, found.paired])
    return dataset.group(
        "model/image",
        {"pixel": view.pixels.pixel, "paired_mode": found.modes["mode"].values[found.paired]},
        velocity=predicted,
        residual=measured - predicted,
        position=view.place,
        **_named("comac", criterion),
        **({} if lines is None else _named("frac", lines.by_pixel(k))),
    )
