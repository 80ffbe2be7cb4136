"""Responses to several places of excitation, seen by the same pixels.

Poles and shapes belong to the structure, and how much a mode takes part to the place: the residue
of pixel d and reference k is ``phi_d L_k``. Lines of all references stand side by side in a
pixel's row, so that one mix of pixels stands for all of them. Noise of references is taken to be
independent, as that of records taken one after the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.modes.line_noise import line_correlation, of_parts
from sldvexp.modes.responses import SAME_LINE, Responses, ViewResponses
from sldvexp.typing import Array, ComplexArray

#: How far, relatively, functions of two references may be from multiples of one another as copies.
COPY = 1e-6


@dataclass(frozen=True, eq=False)
class JointResponses(Responses):
    """Response functions of several references, side by side.

    Parameters
    ----------
    references : mapping of str to Responses
        Of each reference, all of the same pixels and lines; a pixel that one of them flags is
        flagged here.
    """

    references: Mapping[str, Responses] | None = None

    @property
    def each(self) -> Mapping[str, Responses]:
        """Responses of each reference by its name."""
        return self.references or {}

    @property
    def columns(self) -> int:
        """See `Responses`."""
        return len(self.each) * len(self.place)

    @property
    def correlation(self) -> Array | None:
        """See `Responses`; noise of two references is independent."""
        images = [next(iter(own.images.values())) for own in self.each.values()]
        found = [line_correlation(image, self.frequency) for image in images]
        if all(one is None for one in found):
            return None
        alone = np.eye(len(self.frequency), dtype=complex)
        blocks = [alone if one is None else one for one in found]
        return of_parts(np.asarray(scipy.linalg.block_diag(*blocks), complex))

    @property
    def window_rate(self) -> float:
        """See `Responses`; that of all references."""
        rates = {own.window_rate for own in self.each.values()}
        if len(rates) > 1:
            raise UserError("references have exponential windows of several time constants")
        return rates.pop()

    @property
    def level(self) -> Array:
        """See `Responses`."""
        return np.concatenate([own.level for own in self.each.values()])

    def std(self, view: str) -> Array:
        """See `Responses`; lines of the second reference follow those of the first."""
        return np.concatenate([own.std(view) for own in self.each.values()], axis=1)

    def views(self, flagged: bool = False) -> Iterator[ViewResponses]:
        """See `Responses`; lines of the second reference follow those of the first."""
        for parts in zip(*(own.views(flagged) for own in self.each.values()), strict=True):
            seen = np.concatenate([part.velocity for part in parts], axis=1)
            std = np.concatenate([part.std for part in parts], axis=1)
            every = np.concatenate([part.every_line for part in parts], axis=1)
            yield ViewResponses(parts[0].name, seen, std, every)


def join(
    references: Mapping[str, Mapping[str, xr.Dataset]],
    band: tuple[float, float] | None = None,
    left_out: Sequence[float] = (),
) -> JointResponses:
    """Take the lines of a band of several references' images.

    Parameters
    ----------
    references : mapping of str to mapping of str to xarray.Dataset
        By the name of the reference, groups ``image/<view>`` by the name of the view.
    band : pair of float, Hz, optional
    left_out : sequence of float, Hz
        Lines that are not taken.

    Raises
    ------
    UserError
        If references have other views, pixels or lines, or the numbers of one are another's.
    """
    first, images = next(iter(references.items()))
    for name, others in references.items():
        if others.keys() != images.keys():
            raise UserError(
                f"reference {name}: has the views {', '.join(others)}, reference {first} has "
                f"{', '.join(images)}; a mode needs all references in every view"
            )
        for view, image in others.items():
            _require_same(view, image, name, images[view], first)
    flags = {
        view: np.bitwise_or.reduce([others[view]["flags"].values for others in references.values()])
        for view in images
    }
    joined = {
        name: Responses.from_images(
            {v: g.assign(flags=("pixel", flags[v])) for v, g in others.items()}, band, left_out
        )
        for name, others in references.items()
    }
    _require_no_copy(joined)
    one = joined[first]
    return JointResponses(one.frequency, one.images, one.place, one.reference, joined)


def _require_same(view: str, image: xr.Dataset, name: str, other: xr.Dataset, first: str) -> None:
    """Refuse pixels or lines of a view that are not those of the first reference."""
    where = f"view {view}: reference {name}"
    own, its = (
        np.asarray(g["frequency"].values if "frequency" in g.dims else [], float)
        for g in (image, other)
    )
    if len(own) != len(its) or not np.allclose(own, its, rtol=SAME_LINE, atol=0):
        raise UserError(f"{where} has other lines than reference {first}")
    beams = [g["dac"].values for g in (image, other)]
    if beams[0].shape != beams[1].shape or np.abs(beams[0] - beams[1]).max(initial=0) > 0.5:
        raise UserError(
            f"{where} has other pixels than reference {first}; measure the same pixels with every "
            "place of excitation"
        )


def _require_no_copy(joined: Mapping[str, Responses]) -> None:
    """Refuse a reference whose numbers are those of another times a factor."""
    names = list(joined)
    for k, name in enumerate(names):
        for other in names[:k]:
            pairs = zip(joined[name].views(), joined[other].views(), strict=True)
            if all(_copied(a.velocity, b.velocity) for a, b in pairs):
                raise UserError(
                    f"reference {name} has the numbers of reference {other}: nothing is learnt of "
                    "them, and bounds would be too small; leave one out"
                )


def _copied(some: ComplexArray, others: ComplexArray) -> bool:
    """Tell whether numbers are others times one factor."""
    factor = np.vdot(others, some) / max(float(np.vdot(others, others).real), 1e-300)
    return bool(np.linalg.norm(some - factor * others) <= COPY * np.linalg.norm(some))
