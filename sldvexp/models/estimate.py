"""Finite element model against the modes of a run: mapped, tested, corrected, expanded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sldvexp.errors import UserError
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.models.assurance import Assurance
from sldvexp.models.base import ModelSource
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.models.frequency_agreement import (
    FrequencyData,
    FrequencyTest,
    KnownFrequencies,
    examine_frequencies,
)
from sldvexp.models.mapping import PredictedPixels, map_shapes, modal_pixels
from sldvexp.models.modal_mass import ModalMasses, modal_masses
from sldvexp.models.pairing import assurance_matrix, pair_modes
from sldvexp.models.placing import check_place, check_seen
from sldvexp.models.shape_agreement import (
    JointTest,
    ShapeTest,
    StackedPixels,
    examine_shape,
    join_shapes,
)
from sldvexp.models.updating import UpdatedParameters, update_parameters
from sldvexp.pose import cross_covariance
from sldvexp.typing import IntArray


@dataclass(frozen=True, eq=False)
class ExaminedModel:
    """Outcome of a model put to the test.

    Parameters
    ----------
    model : FiniteElementModel
        In the world, with those of its modes that were looked at.
    views : list of PredictedPixels
    pixels : StackedPixels
    mac : Assurance
        Of all pairs, (mode, model_mode).
    pair : ndarray of int, shape (mode,)
        Modes of the model, from 0; -1 of none.
    tests : list of ShapeTest
        Of the pairs, in the order of the measured modes.
    shapes : JointTest
    known : KnownFrequencies
    data : FrequencyData
    frequencies : FrequencyTest
    updated : UpdatedParameters, optional
    masses : ModalMasses, optional
        Where force and reference are known, unless the shapes are rejected.
    modes : xarray.Dataset
        The measured ones.
    confidence : float
    """

    model: FiniteElementModel
    views: list[PredictedPixels]
    pixels: StackedPixels
    mac: Assurance
    pair: IntArray
    tests: list[ShapeTest]
    shapes: JointTest
    known: KnownFrequencies
    data: FrequencyData
    frequencies: FrequencyTest
    updated: UpdatedParameters | None
    masses: ModalMasses | None
    modes: xr.Dataset
    confidence: float

    @cached_property
    def paired(self) -> IntArray:
        """Measured modes with a partner, from 0."""
        return np.array([t.mode for t in self.tests])

    @property
    def shapes_rejected(self) -> bool:
        """True if one of two tests of all shapes says so, each at half the level."""
        level = (1 - self.confidence) / 2
        return min(self.shapes.p_value, self.shapes.directed_p_value) < level

    @property
    def frequencies_judged(self) -> bool:
        """True if something is known of how well the model's frequencies can be right."""
        return any(self.data.tolerance.values()) or bool(self.data.discretisation.any())

    @property
    def frequencies_rejected(self) -> bool:
        """True if one of two tests of all frequencies says so, each at half the level."""
        level = (1 - self.confidence) / 2
        found = self.frequencies
        return self.frequencies_judged and min(found.p_value, found.common_p_value) < level

    @property
    def frequency_verdict(self) -> str:
        """``accepted``, ``rejected``, or ``undecided`` if nothing is said of the model's."""
        if not self.frequencies_judged:
            return "undecided"
        return "rejected" if self.frequencies_rejected else "accepted"


def examine_model(
    tree: Mapping[str, xr.Dataset], laser: TwoMirror, source: ModelSource
) -> ExaminedModel:
    """Put a finite element model to the test by the modes of a run.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        Groups ``modes``, ``modes/image/<view>``, ``pose`` and, if there is one, ``volume``.
    laser : TwoMirror
    source : ModelSource

    Raises
    ------
    UserError
        If the model cannot be read or lies elsewhere, or none of its modes is a measured one, or
        parameters are adjusted that the data does not determine.
    """
    if "modes" not in tree:
        raise UserError("there are no modes to test it on; choose modal=own")
    model, modes = source.model(), tree["modes"]
    check_place(model, tree)
    views = [map_shapes(model, pixels) for pixels in modal_pixels(tree, laser)]
    check_seen(views, model.source)
    mixing = modes["mixing_std"].values if "mixing_std" in modes else None
    size = 6 * len(views)
    joint = cross_covariance(tree["pose"], [view.pixels.name for view in views])
    pixels = StackedPixels.of_views(views, joint.reshape(size, size), mixing)
    measured = modes["natural_frequency"].values
    mac = assurance_matrix(pixels)
    pair = pair_modes(mac.value, measured, model.frequency, source.pair_above)
    paired = np.flatnonzero(pair >= 0)
    if not len(paired):
        raise UserError(
            f"{model.source}: none of its {model.modes} modes has a MAC of {source.pair_above:g} "
            f"with a measured one (the best has {np.max(mac.value):.2g}); are its axes right "
            "(model.frame), and does it have the modes of this band?"
        )
    tests = [examine_shape(pixels, int(r), int(pair[r])) for r in paired]
    known = KnownFrequencies(
        model.frequency,
        source.discretisation_of(model),
        source.sensitivities(model),
        source.tolerances(),
        source.values(),
    )
    data = known.of_pairs(modes, paired, pair[paired])
    updated = update_parameters(data, source.adjust) if source.adjust else None
    found = ExaminedModel(
        model,
        views,
        pixels,
        mac,
        pair,
        tests,
        join_shapes(tests),
        known,
        data,
        examine_frequencies(data),
        updated,
        None,
        modes,
        source.confidence,
    )
    if source.drive is None or found.shapes_rejected or "reference" not in modes:
        return found
    return replace(found, masses=modal_masses(model, tests, modes, source.drive))
