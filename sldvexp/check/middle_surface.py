"""`check=middle_surface`: map of where the middle surface of a thin shell lies, patch by patch.

The kinetic energy of a shell that bends is least in its middle surface, not on the face that is
measured: at the height z above it

    |V|^2 = |w|^2 + z^2 |grad w|^2.

A field in a volume shows it by its layers: of every column of nodes ``V = a + b z``, and in a patch
the sum of ``|a + b z|^2`` is least at ``z = -Re(sum b* a) / sum |b|^2``. A shell's images show it
without layers, by a lever arm of the slopes of each patch's own (`sldvexp.shell.lever`): the middle
lies so far below the face. Both take motion of the middle along itself in phase with the bending
for another height.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sldvexp import dataset
from sldvexp.check.agreement import FEWEST_PARTS, jackknife
from sldvexp.check.base import Check, Examination
from sldvexp.check.on_surface import check_lines, check_patches, surface_field_of
from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity, with_findings
from sldvexp.errors import Checks, UserError
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.shell import Outline, Shell, SurfaceField, SurfaceReconstruction
from sldvexp.shell.lever import bending_lines, joint_arms, patch_of, strongest
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array, IntArray

#: Blocks along each side of a patch, of which one is left out at a time.
BLOCKS = 3


#: Information over the largest, below which a patch tells nothing.
NOTHING = 1e-12


@register("check", "middle_surface")
@dataclass
class MiddleSurface(Check):
    """Height of the middle surface over where it is given, by patches, from velocities alone.

    `surface_depth` finds one height of the whole surface.

    Parameters
    ----------
    patches : list of 2 int
        Into how many the surface is cut along its first and its second direction.
    lines : int
        How many frequencies of most motion the lever arms are taken from.
    level : float
        Probability of doubt about a surface that is where it is given.
    """

    patches: list[int] = field(default_factory=lambda: [5, 4])
    lines: int = 8
    level: float = 0.01

    def __post_init__(self) -> None:
        checks = Checks()
        check_patches(checks, self.patches)
        check_lines(checks, self.lines, self.level)
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Map the middle surface by the layers of a volume's field, and by a shell's lever arms.

        Raises
        ------
        UserError
            If the run has neither.
        """
        e = run.experiment
        methods = {} if e is None else {"field": e.reconstruction, **e.compare}
        shells = [m for m in methods.values() if isinstance(m, Shell)]
        layered = [k for k, m in methods.items() if m and not isinstance(m, SurfaceReconstruction)]
        layered = [name for name in layered if name in run.fields()]
        if not shells and not layered:
            raise UserError("check=middle_surface needs a field: choose a volume, a reconstruction")
        maps: dict[str, MiddleMap] = {}
        if shells:
            found, _ = surface_field_of(run, "middle_surface")
            outline = found.fit.outline
            maps["lever_arm"] = by_lever_arm(found, self._patches, self.lines)
        else:
            outline = Outline.of(e.volume, e.volume.prisms(), 0.0)
        if layered:
            maps["layers"] = by_layers(run, layered[0], outline, self._patches)
        i, j = np.divmod(np.arange(np.prod(self.patches)), self.patches[1])
        place = outline.low + (np.stack([i, j], axis=-1) + 0.5) / self.patches * (
            outline.high - outline.low
        )
        heights = {f"by_{name}": found.height for name, found in maps.items()}
        stds = {f"by_{name}_std": found.std for name, found in maps.items()}
        group = dataset.group(
            "examined/middle_surface",
            {"patch": np.arange(len(place))},
            place_s=place[:, 0],
            place_t=place[:, 1],
            **heights,
            **stds,
        )
        return with_findings(group, [told(maps, place, self.level)])

    @property
    def _patches(self) -> tuple[int, int]:
        return self.patches[0], self.patches[1]


@dataclass(frozen=True, eq=False)
class MiddleMap:
    """Heights of the middle surface over where it is given, NaN where nothing is known.

    Attributes
    ----------
    height, std : ndarray, shape (patch,), m
    p_value : float
        Probability of such heights if the surface is where it is given.
    mean, mean_std : float, m
        Of all patches together.
    """

    height: Array
    std: Array
    p_value: float
    mean: float
    mean_std: float


def by_lever_arm(found: SurfaceField, patches: tuple[int, int], lines: int) -> MiddleMap:
    """Map the middle surface by lever arms of patches, all lines together."""
    fit, sheet = found.fit, found.material
    assert sheet is not None
    count = patches[0] * patches[1]
    both = bending_lines(fit, strongest(fit, lines), patches)
    joint = joint_arms([b[0].arm_system() for b in both], count, common=True)
    told = np.diag(joint.information)
    seen = np.flatnonzero(told > NOTHING * told.max())
    change, covariance = joint.without(np.setdiff1d(np.arange(count), seen)).estimate()
    # Known no better than half the thickness, the arm is no small change of what w was found with.
    sure = np.diag(covariance) < (sheet.thickness / 2) ** 2
    known, change, covariance = seen[sure], change[sure], covariance[np.ix_(sure, sure)]
    if not len(known):
        raise UserError(
            "check=middle_surface: the images do not tell where the middle surface lies; views "
            "from other sides would"
        )
    height, std = np.full((2, count), np.nan)
    # The middle lies a lever arm below the face.
    height[known], std[known] = -change, np.sqrt(np.diag(covariance))
    weight = np.linalg.solve(covariance, np.ones(len(known)))
    common = found.method.height_tolerance**2 + sheet.tolerance.thickness**2 / 4
    chi_square = change @ np.linalg.solve(covariance + common, change)
    return MiddleMap(
        height,
        std,
        float(chi_square_p_value(chi_square, len(known))),
        float(-weight @ change / weight.sum()),
        float(weight.sum() ** -0.5),
    )


def by_layers(run: Examination, name: str, outline: Outline, patches: tuple[int, int]) -> MiddleMap:
    """Map the middle surface by the layers of a volume's field.

    Parameters
    ----------
    name : str
        Of the field.
    outline : Outline
        Of the middle surface, as it is given.
    """
    velocity = run.field_of(name)["velocity"].transpose("node", "component", ...).values
    depth = run.groups["volume"]["depth"].values
    layers = velocity.reshape(len(depth), len(outline.corners), -1)
    known = np.isfinite(layers).all(axis=(0, 2))
    offset = depth - depth.mean()
    slope = np.einsum("l,lnc->nc", offset, layers) / np.sum(offset**2)
    along = np.sum(slope.conj() * layers.mean(axis=0), axis=1).real
    square = np.sum(np.abs(slope) ** 2, axis=1)
    patch = _patch(outline, patches)
    fine = _patch(outline, (patches[0] * BLOCKS, patches[1] * BLOCKS))
    count = patches[0] * patches[1]
    height, std, freedom = np.full((3, count), np.nan)
    for i in range(count):
        mine = known & (patch == i)
        blocks = [mine & (fine == b) for b in np.unique(fine[mine])]
        sums = np.array([[along[b].sum(), square[b].sum()] for b in blocks]).reshape(-1, 2)
        if len(blocks) >= FEWEST_PARTS:
            without = sums.sum(axis=0) - sums
            height[i] = depth.mean() - sums[:, 0].sum() / sums[:, 1].sum() + outline.given
            std[i], freedom[i] = jackknife(-without[:, 0] / without[:, 1]), len(blocks) - 1
    found = np.flatnonzero(np.isfinite(std))
    if not len(found):
        told = f"{patches[0]} x {patches[1]} patches of {BLOCKS} x {BLOCKS} parts each"
        raise UserError(f"check=middle_surface: the volume has too few nodes for {told}")
    t = np.abs(height[found]) / std[found]
    each = 2 * scipy.special.stdtr(freedom[found], -t)
    weight = std[found] ** -2.0
    return MiddleMap(
        height,
        std,
        float(min(1.0, len(found) * each.min())),
        float(weight @ height[found] / weight.sum()),
        float(weight.sum() ** -0.5),
    )


def _patch(outline: Outline, patches: tuple[int, int]) -> IntArray:
    return patch_of(outline, outline.corners, patches)


def told(maps: dict[str, MiddleMap], place: Array, level: float) -> Finding:
    """Say where the middle surface lies, and where it is not where it is given."""
    name, found = min(maps.items(), key=lambda item: item[1].p_value)
    by = {"layers": "layers of the volume", "lever_arm": "lever arms of the slopes"}[name]
    p_value = min(1.0, len(maps) * found.p_value)
    worst = int(np.nanargmax(np.abs(found.height) / found.std))
    off, std = 1e3 * found.height[worst], 1e3 * found.std[worst]
    s, t = 1e3 * place[worst]
    most = f"{off:+.2g} +- {2 * std:.2g} mm around [{s:.3g}, {t:.3g}] mm"
    mean = f"{1e3 * found.mean:+.2g} +- {2e3 * found.mean_std:.2g} mm on average"
    known = f"{np.isfinite(found.std).sum()} patches"
    if p_value < level:
        text = f"by the {by} the middle surface does not lie where it is given: {mean}, {most}"
        severity = Severity.doubtful
    else:
        text = f"by the {by} of {known} the middle surface lies where it is given: {mean}"
        severity = Severity.note
    return Finding("middle_surface", "surface", text, severity, np.nan, p_value, abs(off))
