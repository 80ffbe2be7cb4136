"""What every format of an export has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from sldvexp.errors import UserError
from sldvexp.export.results import Results, results_of
from sldvexp.lazy import xarray as xr


class Export(ABC):
    """Writes a run's velocities as a file for other programs."""

    #: How the file's name ends.
    suffix: ClassVar[str]

    @abstractmethod
    def write(self, results: Results, path: Path) -> None:
        """Write the file, and others that it names, each whole or not at all and itself last.

        Parameters
        ----------
        results : Results
        path : Path

        Raises
        ------
        UserError
            If the format cannot hold what the run has, or needs what it has not.
        """

    def export(
        self,
        tree: Mapping[str, xr.Dataset],
        attributes: Mapping[Any, Any],
        folder: Path,
        name: str,
    ) -> Path:
        """Write a run's velocities into a folder.

        Parameters
        ----------
        tree : mapping of str to xarray.Dataset
            Groups by their path.
        attributes : mapping
            Of the tree's root.
        folder : Path
        name : str
            Of the file, without its suffix.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        UserError
            If the name is none of a file, the run has no velocities, `write` refuses them, or the
            file cannot be written.
        """
        if Path(name).name != name or name.startswith("."):
            raise UserError(f"export: {name} is the name of a file and cannot name a folder")
        path = folder / f"{name}{self.suffix}"
        self.write(results_of(tree, attributes), path)
        return path


def export_all(
    exports: Mapping[str, Export],
    tree: Mapping[str, xr.Dataset],
    attributes: Mapping[Any, Any],
    run_file: Path,
) -> list[Path]:
    """Write every export of a run beside its file.

    Parameters
    ----------
    exports : mapping of str to Export
    tree : mapping of str to xarray.Dataset
    attributes : mapping
        Of the tree's root.
    run_file : Path
        The run's own file, which is there already.

    Returns
    -------
    list of Path

    Raises
    ------
    UserError
        At the first that cannot be written.
    """
    found = []
    for name, export in exports.items():
        try:
            found.append(export.export(tree, attributes, run_file.parent, name))
        except UserError as error:
            raise UserError(f"export.{name}: {error} (the run is in {run_file})") from None
    return found
