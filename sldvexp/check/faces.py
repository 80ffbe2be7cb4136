"""`check=faces`: agreement of the face and the back of a thin shell, where views saw both.

Both sides tell of one middle surface, and of its slopes by lever arms that are as far apart as the
faces are, ``u_face - u_back = -h grad w`` (`sldvexp.shell.two_sides`). What the views of one side
tell beside that, another motion or another lever arm, is shear of the sheet, motion of its inside,
or poses of the two sides that do not go together. Motion of the middle along itself is none of
these, and shifts nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.on_surface import check_level, surface_field_of
from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity, with_findings
from sldvexp.errors import Checks
from sldvexp.lazy import xarray as xr
from sldvexp.shell import SurfaceField
from sldvexp.shell.two_sides import COMPONENTS, TwoSides
from sldvexp.statistics import chi_square_p_value, student_factor

#: Names of the components in sentences.
ALONG = ("along its first direction", "along its second direction", "along its normal")


@register("check", "faces")
@dataclass
class Faces(Check):
    """Motion that views of the face and views of the back tell of, against one another.

    It needs a thin shell, and `volume.sight.both_sides`.

    Parameters
    ----------
    level : float
        Probability of doubt about sides that agree.
    """

    level: float = 0.01

    def __post_init__(self) -> None:
        checks = Checks()
        check_level(checks, self.level)
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Compare both sides by low-order waves of their difference, and by their lever arm.

        Raises
        ------
        UserError
            If the run has no field of a thin shell.
        """
        found, _ = surface_field_of(run, "faces")
        faces = ComparedFaces.of(found)
        group = dataset.group(
            "examined/faces",
            {"component": ["t1", "t2", "n"]},
            lever_arm=faces.distance + faces.change,
            lever_arm_std=faces.std,
            distance=faces.distance,
            p_arm=faces.p_arm,
            chi_square=faces.chi_square[0],
            freedom=faces.chi_square[1],
            p_difference=faces.p_difference,
            p_beside=faces.p_beside,
            component_p_value=np.array(faces.by_component),
        )
        return with_findings(group, [told(faces, self.level)])


@dataclass(frozen=True, eq=False)
class ComparedFaces:
    """What the two sides of a sheet tell of one another; NaN where one of them is unseen.

    Attributes
    ----------
    seen : tuple of int
        How many views see the face, and the back.
    distance : float, m
        Of the faces, which is the thickness.
    change, std : float, m
        Of the lever arm from it, and its standard error.
    chi_square, beside : tuple of float and float
        Of low-order differences, and degrees of freedom: with the lever arm as stated, and free.
    by_component : tuple of float
        Probabilities of such a difference of one component alone.
    """

    seen: tuple[int, int]
    distance: float
    change: float = np.nan
    std: float = np.nan
    chi_square: tuple[float, float] = (np.nan, np.nan)
    beside: tuple[float, float] = (np.nan, np.nan)
    by_component: tuple[float, ...] = (np.nan,) * COMPONENTS

    @classmethod
    def of(cls, found: SurfaceField) -> ComparedFaces:
        """Compare the two sides of a shell field."""
        assert found.material is not None
        sides = [p.side for p in found.fit.pixels if len(p.pixel)]
        seen, distance = (sides.count(1), sides.count(-1)), found.material.thickness
        if not all(seen):
            return cls(seen, distance)
        two = TwoSides.of(found.fit)
        each = [two.difference_test(False, i) for i in range(COMPONENTS)]
        return cls(
            seen,
            distance,
            *two.lever_arm(),
            two.difference_test(free_arm=False),
            two.difference_test(free_arm=True),
            tuple(float(chi_square_p_value(*one)) for one in each),
        )

    @property
    def p_arm(self) -> float:
        """Probability of such a lever arm, if it is the distance of the faces."""
        return float(chi_square_p_value((self.change / self.std) ** 2, 1))

    @property
    def p_difference(self) -> float:
        """Probability of such differences, if the sides move as one sheet."""
        return float(chi_square_p_value(*self.chi_square))

    @property
    def p_beside(self) -> float:
        """Probability of such differences, whatever the lever arm is."""
        return float(chi_square_p_value(*self.beside))

    @property
    def p_value(self) -> float:
        """Probability of either."""
        return min(1.0, 2 * min(self.p_arm, self.p_difference))


def told(faces: ComparedFaces, level: float) -> Finding:
    """Say in a sentence that the sides agree, or what would make them."""
    if not all(faces.seen):
        side, other = ("face", "back") if faces.seen[0] else ("back", "face")
        text = (
            f"the views see the {side} of the sheet alone, so that nothing of its {other} can be "
            "compared; it takes views of the other side, and volume.sight.both_sides=true"
        )
        return Finding("faces", "surface", text, Severity.note)
    off, mm = faces.change, 1e3
    arm = f"{mm * (faces.distance + off):.4g} +- {2 * mm * faces.std:.2g} mm"
    stated = f"where they are {mm * faces.distance:.4g} mm apart"
    severity = Severity.note
    text = f"face and back of the sheet agree: by their slopes the faces are {arm} apart, {stated}"
    if faces.std > faces.distance:
        text = (
            "face and back of the sheet agree, though how far apart they are by their slopes is "
            f"known to {2 * mm * faces.std:.2g} mm only: steeper views would tell more"
        )
    if faces.p_value < level:
        severity = Severity.doubtful
        text = f"face and back of the sheet do not agree: {_cause(faces, arm, stated, level)}"
    size = mm * abs(off)
    return Finding("faces", "surface", text, severity, faces.chi_square[0], faces.p_value, size)


def _cause(faces: ComparedFaces, arm: str, stated: str, level: float) -> str:
    """Name what would make the sides agree."""
    off, z = faces.change, float(student_factor(1 - level, np.inf))
    by_arm = abs(off) > z * faces.std
    apart = f"{1e3 * abs(off):.2g} mm too {'far apart' if off < 0 else 'close together'}"
    poses = f"the poses put the views of the two sides {apart} along the normal"
    shear = f"shear takes {-100 * off / faces.distance:.2g} % of the slope, or " if off < 0 else ""
    if by_arm and faces.p_beside >= level:
        return f"they would if their slopes' lever arms were {arm} apart, {stated}: {shear}{poses}"
    most = ALONG[int(np.argmin(faces.by_component))]
    beside = f"; beside it their lever arms are {arm} apart, {stated}" if by_arm else ""
    if faces.p_beside < level:
        chi_square, freedom = faces.beside
        most += f", as no lever arm explains (chi-square {chi_square:.4g} of {freedom:.4g})"
    return (
        f"most {most}: poses of the two sides do not go together, or the inside of the sheet "
        f"moves{beside}"
    )
