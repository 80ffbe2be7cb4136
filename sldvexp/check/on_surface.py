"""Shell field of a run, as the checks of a thin shell's physics take it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp.check.base import Examination
from sldvexp.errors import Checks, UserError
from sldvexp.shell import SurfaceField
from sldvexp.shell.estimate import reconstruct_surface
from sldvexp.shell.shell import Shell
from sldvexp.typing import Array


def check_lines(checks: Checks, lines: int, level: float) -> None:
    """Note what no number of lines, and no probability of a false alarm, can be."""
    checks.require(lines >= 1, "lines", f"must be 1 or more, not {lines}")
    message = f"must lie between 0 and 1 as in 0.01, not {level}"
    checks.require(0 < level < 1, "level", message)


def check_patches(checks: Checks, patches: Sequence[int]) -> None:
    """Note into what numbers of patches no surface can be cut."""
    right = len(patches) == 2 and all(n >= 1 for n in patches)
    message = f"must be 2 numbers of 1 or more, as in [6, 5], not {patches}"
    checks.require(right, "patches", message)


def shell_field_of(run: Examination, check: str) -> tuple[SurfaceField, Array]:
    """Estimate the field of a thin shell anew from a run's images, with their frequencies.

    Parameters
    ----------
    check : str
        Name of the check that needs it, for the sentence.

    Raises
    ------
    UserError
        If the run has no such method, or does not know its frequencies.
    """
    e = run.experiment
    methods = [e.reconstruction, *e.compare.values()] if e is not None else []
    method = next((m for m in methods if isinstance(m, Shell)), None)
    if method is None:
        raise UserError(f"check={check} needs reconstruction=shell, or one in compare")
    found = reconstruct_surface(run.groups, e.laser, e.volume, method, e.material)
    if found.frequency is None:
        raise UserError(f"check={check} needs the frequency of the images, which none of them says")
    return found, np.asarray(found.frequency, float)
