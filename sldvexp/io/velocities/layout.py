"""How a file of others differs from the program's own: names, order of dimensions, group."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from sldvexp.errors import UserError, nearest

#: What a name of a file may stand for.
KNOWN = (
    "view",
    "point",
    "frequency",
    "axis",
    "direction_cosines",
    "velocity",
    "velocity_std",
    "real",
    "imag",
    "std",
    "dx",
    "dy",
    "dz",
)
ORDER = ("view", "point", "frequency")


@dataclass(frozen=True)
class Layout:
    """Names and order of a file.

    Parameters
    ----------
    mapping : mapping of str to str
        From the file's names of variables, dimensions or columns to the program's.
    order : tuple of str
        Dimensions of the velocities where they have no names; all of `ORDER` that there are.
    group : str
        Of a netCDF file; empty for its root.
    """

    mapping: Mapping[str, str] = field(default_factory=dict)
    order: tuple[str, ...] = ()
    group: str = ""

    def require(self, names: Iterable[Hashable], path: Path) -> None:
        """Complain about names that the file does not have."""
        known = [str(name) for name in names]
        for theirs in self.mapping:
            if theirs not in known:
                raise UserError(
                    f"{path}: instrument.mapping names {theirs}, which the file has not; "
                    f"{nearest(theirs, known)}"
                )


OWN = Layout()
