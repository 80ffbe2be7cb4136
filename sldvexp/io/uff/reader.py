"""A universal file as a whole: what is in it at once, what its functions say when asked."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from numpy.typing import NDArray

from sldvexp.io.uff.functions import (
    NODAL,
    Function,
    Units,
    read_amplitude,
    read_header,
    read_units,
    read_values,
)
from sldvexp.io.uff.geometry import UniversalGeometry, read_geometry
from sldvexp.io.uff.index import DataSet, index
from sldvexp.io.uff.nodal import ShapeFunctions, read_nodal
from sldvexp.io.uff.source import Source, opened


@dataclass(eq=False)
class UniversalFile:
    """An open universal file. Nothing but `values` reads what a function's header does not say.

    Parameters
    ----------
    entries : list of DataSet
        Its data sets, in the file's order.
    """

    source: Source
    entries: list[DataSet]
    _shapes: ShapeFunctions | None = field(default=None, repr=False)

    @cached_property
    def functions(self) -> list[Function]:
        """Headers of the data sets 58 and 58b."""
        return [read_header(self.source, e) for e in self.entries if e.kind == 58]

    def nodal_functions(self, containing: str = "") -> list[Function]:
        """Read data sets 55, each as a whole, as functions of frequency.

        Parameters
        ----------
        containing : str
            Text that the data sets' identifying lines must have.

        Raises
        ------
        UserError
            See `sldvexp.io.uff.nodal.read_nodal` and `ShapeFunctions`.
        """
        entries = [e for e in self.entries if e.kind == NODAL]
        sets = [n for e in entries if (n := read_nodal(self.source, e, containing)) is not None]
        self._shapes = ShapeFunctions(self.source, sets) if sets else None
        return self._shapes.functions if self._shapes else []

    @cached_property
    def geometry(self) -> UniversalGeometry | None:
        """Nodes, elements and lines; None if there are no nodes."""
        return read_geometry(self.source, self.entries)

    @cached_property
    def units(self) -> Units | None:
        """The units of lengths; None if the file does not state them."""
        return read_units(self.source, self.entries)

    @cached_property
    def amplitude(self) -> tuple[int, DataSet] | None:
        """The scale of amplitudes and who states it; None if it is unknown."""
        return read_amplitude(self.source, self.entries)

    def values(self, function: Function) -> tuple[NDArray, NDArray]:
        """Read abscissa and ordinate of a function; see `sldvexp.io.uff.functions.read_values`."""
        if function.kind == NODAL and self._shapes is not None:
            return self._shapes.values_of(function)
        return read_values(self.source, function)

    def wrong(self, function: Function, message: str) -> Exception:
        """Word the error of a function as a whole."""
        return function.entry.wrong(self.source, function.entry.first, message)


@contextmanager
def universal_file(path: Path) -> Iterator[UniversalFile]:
    """Open a universal file and find its data sets.

    Raises
    ------
    UserError
        If it is missing or is no universal file.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from sldvexp.io.uff import writer
    >>> path = Path(tempfile.mkdtemp(), "points.uff")
    >>> _ = path.write_text(writer.units() + writer.nodes(np.eye(3), np.ones(3, int)))
    >>> with universal_file(path) as file:
    ...     print(file.units, file.geometry.label)
    Units(name='SI: Meter (newton)', length=1.0) [1 2 3]
    """
    with opened(path) as source:
        yield UniversalFile(source, index(source))
