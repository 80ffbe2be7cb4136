"""Smooth field of a run's surface, as the checks of a thin shell's physics take it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp.check.base import Examination
from sldvexp.errors import Checks, UserError
from sldvexp.shell import SurfaceField, SurfaceReconstruction
from sldvexp.shell.estimate import reconstruct_surface
from sldvexp.shell.shell import Shell
from sldvexp.typing import Array


def check_level(checks: Checks, level: float) -> None:
    """Note what no probability of a false alarm can be."""
    checks.require(0 < level < 1, "level", f"must lie between 0 and 1 as in 0.01, not {level}")


def check_lines(checks: Checks, lines: int, level: float) -> None:
    """Note what no number of lines, and no probability of a false alarm, can be."""
    checks.require(lines >= 1, "lines", f"must be 1 or more, not {lines}")
    check_level(checks, level)


def check_patches(checks: Checks, patches: Sequence[int]) -> None:
    """Note into what numbers of patches no surface can be cut."""
    right = len(patches) == 2 and all(n >= 1 for n in patches)
    message = f"must be 2 numbers of 1 or more, as in [6, 5], not {patches}"
    checks.require(right, "patches", message)


def surface_field_of(
    run: Examination, check: str, kind: type[SurfaceReconstruction] = Shell
) -> tuple[SurfaceField, Array]:
    """Estimate the smooth field of a surface anew from a run's images, with their frequencies.

    It is estimated once for all checks of a run that take it from the same method.

    Parameters
    ----------
    check : str
        Name of the check that needs it, for the sentence.
    kind : type
        Of the methods that will do; the first of the run's is taken.

    Raises
    ------
    UserError
        If the run has no such method, or does not know its frequencies.
    """
    e = run.experiment
    methods = {} if e is None else {"field": e.reconstruction, **e.compare}
    name = next((name for name, method in methods.items() if isinstance(method, kind)), None)
    if name is None:
        wanted = "shell" if kind is Shell else "shell or spline"
        raise UserError(f"check={check} needs reconstruction={wanted}, or one in compare")
    key = f"surface of {name}"
    if key not in run.kept:
        method = methods[name]
        run.kept[key] = reconstruct_surface(run.groups, e.laser, e.volume, method, e.material)
    found: SurfaceField = run.kept[key]
    if found.frequency is None:
        raise UserError(f"check={check} needs the frequency of the images, which none of them says")
    return found, np.asarray(found.frequency, float)
