"""`export=vtu`: a field for ParaView."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.export.base import Export
from sldvexp.export.results import PrismMesh, Results
from sldvexp.export.vtk_file import pvd, vtu
from sldvexp.files import whole_or_nothing


@register("export", "vtu")
@dataclass
class Vtu(Export):
    """Prisms with the complex velocity and its bounds as VTU, collected in two PVD files.

    ``<name>.pvd`` steps through the frequencies, with the frequency in Hz as its time: real and
    imaginary part, amplitude and phase (rad) along x, y, z in m/s, and standard error, confidence
    and ``observable`` of the components as they were found; ``real`` and ``imag`` are local ones.
    ``<name>_phase.pvd`` plays a period of one frequency: ``velocity`` and ``displacement`` (m) at
    each instant, the latter for "Warp By Vector". The files that they collect lie in a folder,
    ``<name>``. What is not determined is NaN.

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

    def write(self, results: Results, path: Path) -> None:
        """Write the folder's files and the period, then the collection of the frequencies.

        Raises
        ------
        UserError
            If there is no field, or not the frequency that is to be animated.
        """
        mesh = results.needed_mesh("vtu")
        index = self._animated(results)
        folder = path.with_suffix("")
        folder.mkdir(exist_ok=True)
        comment = "; ".join(f"{k}: {v}" for k, v in results.about.items())
        times = [0.0] if results.frequency is None else results.frequency.tolist()
        files = {}
        local = {k: results.components for k in ("observable", *results.bounds, "real", "imag")}
        for i, time in enumerate(times):
            file = folder / f"frequency_{i + 1:05d}.vtu"
            _put(file, vtu(mesh, _spectral(results, mesh, i), local, time, comment))
            files[time] = file.relative_to(path.parent)
        if self.phases:
            played = {}
            for k in range(self.phases):
                arrays, time = _instant(results, mesh, index, k / self.phases)
                file = folder / f"phase_{k + 1:05d}.vtu"
                _put(file, vtu(mesh, arrays, {}, time, comment))
                played[time] = file.relative_to(path.parent)
            _put(path.with_name(f"{path.stem}_phase.pvd"), pvd(played, comment))
        _put(path, pvd(files, comment))

    def _animated(self, results: Results) -> int:
        """Index of the frequency whose period is played."""
        if self.animated is None:
            return results.strongest
        known = [] if results.frequency is None else results.frequency.tolist()
        if self.animated not in known:
            nearest = min(known, key=lambda f: abs(f - self.animated), default=None)
            told = "it knows no frequency" if nearest is None else f"the nearest is {nearest}"
            raise UserError(f"export=vtu: the run has nothing at {self.animated} Hz; {told}")
        return known.index(self.animated)


def _spectral(results: Results, mesh: PrismMesh, i: int) -> dict[str, NDArray]:
    """Everything known at one frequency."""
    velocity = results.in_world(mesh)[..., i]
    own = results.velocity[..., i]
    count = len(velocity)
    return {
        "node": np.arange(1, count + 1, dtype=np.int32),
        "layer": (np.arange(count) // mesh.surface_nodes).astype(np.int32),
        "observable": results.observable.astype(np.uint8),
        "velocity_real": velocity.real,
        "velocity_imag": velocity.imag,
        "velocity_amplitude": np.abs(velocity),
        "velocity_phase": np.angle(velocity),
        **({"real": own.real, "imag": own.imag} if results.local else {}),
        **{name: bound[..., i] for name, bound in results.bounds.items()},
    }


def _instant(
    results: Results, mesh: PrismMesh, i: int, part: float
) -> tuple[dict[str, NDArray], float]:
    """What moves how after a part of the period, and when that is in s, or the part itself."""
    turned = results.in_world(mesh)[..., i] * np.exp(2j * np.pi * part)
    if results.frequency is None or results.frequency[i] <= 0:
        return {"velocity": turned.real}, part
    omega = 2 * np.pi * results.frequency[i]
    arrays = {"velocity": turned.real, "displacement": (turned / (1j * omega)).real}
    return arrays, part / float(results.frequency[i])


def _put(path: Path, text: str) -> None:
    with whole_or_nothing(path) as beside:
        beside.write_text(text)
