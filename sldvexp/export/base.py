"""Contract of the exports: a new one is a file here and a line in `sldvexp.config.experiment`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import ClassVar

from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError, nearest
from sldvexp.export.velocities import GROUPS, with_modes


class Export(ABC):
    """Base of the formats, each of which writes results of a run, mostly its velocities.

    Attributes
    ----------
    suffix : str
        How the file's name ends.
    called : str
        Name of the file, as a rule, where nobody gives another.
    groups : tuple of str
        Groups of the run that it looks at; with a slash at the end, all below.
    """

    suffix: ClassVar[str]
    called: ClassVar[str] = "velocity"
    groups: ClassVar[tuple[str, ...]] = GROUPS

    @property
    def usual_name(self) -> str:
        """Name of the file where nobody gives another."""
        return self.called

    @abstractmethod
    def write(self, run: RunData, path: Path) -> None:
        """Write the file, and others that it names, each whole or not at all and itself last.

        Parameters
        ----------
        run : RunData
            `sldvexp.export.velocities` has functions that take out of it what formats need.

        Raises
        ------
        UserError
            If the format cannot hold what the run has, or needs what it has not.
        """

    def export(self, run: RunData, folder: Path, name: str) -> Path:
        """Write a run's results into a folder.

        Parameters
        ----------
        folder : Path
            It is there already.
        name : str
            Of the file, without its suffix.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        UserError
            If the name is none of a file, `write` refuses what the run has, or the
            file cannot be written.
        """
        if Path(name).name != name or name.startswith(".") or not name.isprintable():
            raise UserError(f"export: {name!r} is the name of a file and cannot name a folder")
        path = folder / f"{name}{self.suffix}"
        self.write(run, path)
        return path


class VelocitiesOf(Enum):
    """What the exported velocities are.

    Attributes
    ----------
    lines
        Those at the frequencies of the excitation.
    modes
        Mode shapes, each at its natural frequency; as peak velocities at resonance.
    """

    lines = "lines"
    modes = "modes"


@dataclass
class VelocityExport(Export):
    """Base of the formats that hold velocities over a field or at points.

    Parameters
    ----------
    of : VelocitiesOf
        What is written: the velocities at the lines, or mode shapes.
    """

    of: VelocitiesOf = field(default=VelocitiesOf.lines, kw_only=True)

    @property
    def usual_name(self) -> str:
        """Name of the file where nobody gives another; that of modes is another one."""
        return "modes" if self.of is VelocitiesOf.modes else self.called

    def export(self, run: RunData, folder: Path, name: str) -> Path:
        """Write what is chosen of the run, see `Export.export`."""
        chosen = with_modes(run) if self.of is VelocitiesOf.modes else run
        return super().export(chosen, folder, name)


def one_view(format_name: str, chosen: str, views: Collection[str]) -> str:
    """Choose the view of a format that holds one.

    Parameters
    ----------
    chosen : str
        As it was asked for; may be empty if there is one only.

    Raises
    ------
    UserError
        If there is no such view, or several and none is chosen.

    Examples
    --------
    >>> one_view("reg", "", ["front"]), one_view("reg", "left", ["front", "left"])
    ('front', 'left')
    """
    if chosen in views:
        return chosen
    if chosen:
        raise UserError(
            f"export={format_name}: there is no view {chosen}; {nearest(chosen, views)}"
        )
    if len(views) > 1:
        raise UserError(
            f"export={format_name} holds one view; say which with view, of {', '.join(views)}"
        )
    return next(iter(views))


def export_all(exports: Mapping[str, Export], run: RunData, folder: Path) -> list[Path]:
    """Write every export of a run.

    Parameters
    ----------
    exports : mapping of str to Export
        By the names of their files.
    folder : Path
        Where to; it is there already.

    Raises
    ------
    UserError
        At the first that cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> class Note(Export):
    ...     suffix = ".txt"
    ...
    ...     def write(self, run, path):
    ...         path.write_text(", ".join(run.groups))
    >>> folder, run = Path(tempfile.mkdtemp()), RunData({"field": None})
    >>> [path.read_text() for path in export_all({"note": Note()}, run, folder)]
    ['field']
    """
    found = []
    for name, export in exports.items():
        try:
            found.append(export.export(run, folder, name))
        except UserError as error:
            raise UserError(f"export.{name}: {error}") from None
    return found
