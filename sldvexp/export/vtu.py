"""`export=vtu`: a field, or points whose positions are known, for ParaView."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import Checks
from sldvexp.export.base import VelocityExport
from sldvexp.export.motion import frequency_index
from sldvexp.export.paraview_script import paraview_script
from sldvexp.export.strains import at_frequency, beside, strain_of
from sldvexp.export.velocities import (
    PrismMesh,
    bounds_of,
    describe,
    frequencies_of,
    is_local,
    mesh_of,
    velocities_of,
    velocity_in_world,
)
from sldvexp.io import pvd, vtu
from sldvexp.lazy import xarray as xr
from sldvexp.typing import ComplexArray
from sldvexp.writing import require_no_link, whole_or_nothing


@register("export", "vtu")
@dataclass
class Vtu(VelocityExport):
    """Prisms, or points, with the complex velocity and its bounds as VTU, collected in PVD files.

    ``<name>.pvd`` steps through the frequencies, with the frequency in Hz as its time: real and
    imaginary part, amplitude and phase (rad) along x, y, z in m/s, and standard error, confidence
    and ``observable`` of the components as they were found; ``real`` and ``imag`` are local ones.
    ``<name>_phase.pvd`` plays a period of one frequency: ``velocity`` and ``displacement`` (m) at
    each instant, and ``determined``; ``<name>_paraview.py`` opens it in ParaView, warped as far
    as the report's page does, coloured by the velocity and ready to play (File, Load State, or
    ``paraview --state=<name>_paraview.py``). The files that they collect lie in a folder,
    ``<name>``, each with the arrays set active that are looked at first. What is not determined is
    NaN. ``<name>_strain.pvd`` steps through the frequencies with everything known of strain, stress
    and force resultants at the nodes of the surface; their components are along t1 and t2,
    ``principal_vector`` is the largest extension in the world, and ``displacement_real`` and
    ``_imag`` (m) are those of the surface.

    Parameters
    ----------
    phases : int
        Instants of the period; 0 leaves it out.
    animated : float, optional
        Frequency of that period in Hz; without it, the strongest of the field.
    """

    phases: int = 24
    animated: float | None = None

    suffix = ".pvd"

    def __post_init__(self) -> None:
        checks = Checks()
        few = self.phases == 0 or self.phases >= 3
        checks.require(few, "phases", f"must be 0 or at least 3, not {self.phases}")
        if self.animated is not None:
            checks.positive("animated", self.animated)
        checks.done()

    def write(self, run: RunData, path: Path) -> None:
        """Write the folder's files and the period, then the collection of the frequencies.

        Raises
        ------
        UserError
            If places are not known, or not the frequency that is to be animated.
        """
        found, mesh = velocities_of(run), mesh_of(run, "vtu")
        frequency, world = frequencies_of(found), velocity_in_world(found, mesh)
        index = frequency_index(world[mesh.surface_layer], frequency, self.animated, "vtu")
        folder = path.with_suffix("")
        require_no_link(folder)
        folder.mkdir(exist_ok=True)
        comment = "; ".join(f"{k}: {v}" for k, v in describe(run).items())
        own = ("observable", *bounds_of(found), "real", "imag")
        components = dict.fromkeys(own, found["component"].values.tolist())

        def put(name: str, arrays: dict[str, NDArray], time: float, *active: str) -> Path:
            first = dict(zip(("Scalars", "Vectors"), active, strict=True))
            text = vtu(mesh.position, mesh.cells, arrays, components, time, comment, first)
            _put(folder / name, text)
            return (folder / name).relative_to(path.parent)

        files = {}
        for i, time in enumerate([0.0] if frequency is None else frequency.tolist()):
            arrays, first = (
                _spectral(found, mesh, world, i),
                ("velocity_amplitude", "velocity_real"),
            )
            files[time] = put(f"frequency_{i + 1:05d}.vtu", arrays, time, *first)
        if self.phases:
            played = {}
            hertz = None if frequency is None else float(frequency[index])
            for k in range(self.phases):
                arrays, time = _instant(world[..., index], hertz, k / self.phases)
                moved = "displacement" if "displacement" in arrays else "velocity"
                played[time] = put(f"phase_{k + 1:05d}.vtu", arrays, time, "velocity", moved)
            _put(path.with_name(f"{path.stem}_phase.pvd"), pvd(played, comment))
            text = paraview_script(path.stem, mesh, world[..., index], hertz)
            _put(path.with_name(f"{path.stem}_paraview.py"), text)
        if (strain := strain_of(run)) is not None:
            moving = np.allclose(mesh.position[mesh.surface_layer], strain["position"].values)
            seen = world[mesh.surface_layer] if moving else None
            _put(beside(path), pvd(_strains(strain, folder, comment, seen), comment))
        _put(path, pvd(files, comment))


def _strains(
    strain: xr.Dataset, folder: Path, comment: str, velocity: ComplexArray | None
) -> dict[float, Path]:
    """Write the strain at every frequency into the folder, and displacements if they are known."""
    position, triangles = strain["position"].values, strain["triangle"].values
    components: dict[str, list[str]] = {}
    for dimension in ("strain_component", "principal"):
        labels = [str(label) for label in strain[dimension].values]
        for name in (str(n) for n in strain if dimension in strain[n].dims):
            components |= {f"{name}{end}": labels for end in ("", "_real", "_imag")}
    files = {}
    for i, hertz in enumerate(strain["frequency"].values.tolist()):
        arrays = dict(at_frequency(strain, i))
        if velocity is not None and hertz > 0:
            displacement = velocity[..., i] / (2j * np.pi * hertz)
            arrays |= {
                "displacement_real": displacement.real,
                "displacement_imag": displacement.imag,
            }
        active = {"Scalars": "von_mises" if "von_mises" in arrays else "principal_strain"}
        active["Vectors"] = (
            "displacement_real" if "displacement_real" in arrays else "principal_vector"
        )
        path = folder / f"strain_{i + 1:05d}.vtu"
        _put(path, vtu(position, [triangles], arrays, components, hertz, comment, active))
        files[hertz] = path.relative_to(folder.parent)
    return files


def _spectral(
    found: xr.Dataset, mesh: PrismMesh, world: ComplexArray, i: int
) -> dict[str, NDArray]:
    """Collect everything known at one frequency."""
    velocity = world[..., i]
    own = found["velocity"].values[..., i]
    count = len(velocity)
    return {
        "node": np.arange(1, count + 1, dtype=np.int32),
        "layer": (np.arange(count) // mesh.surface_nodes).astype(np.int32),
        "observable": found["observable"].values.astype(np.uint8),
        "velocity_real": velocity.real,
        "velocity_imag": velocity.imag,
        "velocity_amplitude": np.abs(velocity),
        "velocity_phase": np.angle(velocity),
        **({"real": own.real, "imag": own.imag} if is_local(found) else {}),
        **{name: bound[..., i] for name, bound in bounds_of(found).items()},
    }


def _instant(
    velocity: ComplexArray, hertz: float | None, part: float
) -> tuple[dict[str, NDArray], float]:
    """Find the motion after a part of the period, and when that is in s, or the part itself."""
    turned = velocity * np.exp(2j * np.pi * part)
    known = np.isfinite(velocity).all(axis=1).astype(np.uint8)
    arrays = {"velocity": turned.real, "determined": known}
    if not hertz:
        return arrays, part
    return arrays | {"displacement": (turned / (2j * np.pi * hertz)).real}, part / hertz


def _put(path: Path, text: str) -> None:
    """Write a file whole or not at all; all of them are synced when they are in their places."""
    with whole_or_nothing(path, lasting=False) as whole:
        whole.write_text(text, encoding="utf-8")
