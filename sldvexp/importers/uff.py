"""`instrument=uff`: what vibrometers and analysers wrote into universal files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.importers.pointwise import Pointwise

if TYPE_CHECKING:
    from sldvexp.importers.measured import Measured


class Kind(Enum):
    """Which functions are read; the value is their type in data set 58, or the data set."""

    frf = 4
    spectrum = 12
    time = 1
    cross = 3
    nodal = 55


class Estimator(Enum):
    """How response functions are made of cross spectra.

    Attributes
    ----------
    h1
        ``G_xf / G_ff``, divided by the reference's auto spectrum: right with noise in responses.
    h2
        ``G_xx / G_fx``, of the response's auto spectrum: right with noise in the reference.
    """

    h1 = "h1"
    h2 = "h2"


class NodalAxes(Enum):
    """What the directions of nodal values are.

    Attributes
    ----------
    world
        Those of the positions.
    node
        Those of each node's own coordinate system.
    """

    world = "world"
    node = "node"


@register("instrument", "uff")
@dataclass
class Uff(Pointwise):
    """Functions and geometry of universal files (data sets 58, 58b, 15, 2411, 2412, 82, ...).

    What a file does not say, and a setting does not either, is asked for.

    Parameters
    ----------
    geometry : str
        File with the nodes; empty for those in each view's own file.
    function : Kind, optional
        Needed if a file has more than one of frequency response functions, spectra, time records.
        Cross spectra are read if there are no response functions, or as set. Nodal values (data
        set 55) are read if there are no functions, or as set.
    estimator : Estimator, optional
        Of response functions from cross and auto spectra: h1 by the reference's auto spectrum, h2
        by the response's.
    nodal_axes : NodalAxes, optional
        Needed of nodal values with directions=dof if nodes have coordinate systems of their own.
    containing : str
        Text that the identifying lines of a function must have, as ``H1``.
    averages : int
        Of spectra behind each response function: with it, standard errors come from the file's
        coherence functions, or from cross and both auto spectra. 0 if not known.
    time_reference : str
        Of time records: degree of freedom of the one whose phase is zero, as ``99+Z``, or
        ``trigger`` if all begin at one phase of the excitation.
    """

    geometry: str = ""
    function: Kind | None = None
    estimator: Estimator | None = None
    nodal_axes: NodalAxes | None = None
    containing: str = ""
    averages: int = 0
    time_reference: str = ""

    def check(self, checks: Checks) -> None:
        """Note what cannot be."""
        both = self.std is not None and self.averages
        checks.require(not both, "averages", "give either std or averages, not both")
        message = f"must be zero or a positive integer, not {self.averages}"
        checks.require(self.averages >= 0, "averages", message)

    def inputs(self) -> list[str]:
        """The universal files."""
        return [*([self.geometry] if self.geometry else []), *super().inputs()]

    def measured(self) -> Iterator[Measured]:
        """What the views' files say; see `sldvexp.importers.uff_views.measured`."""
        from sldvexp.importers.uff_views import measured

        return measured(self)
