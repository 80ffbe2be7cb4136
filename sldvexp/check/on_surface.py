"""Shell field of a run, as the checks of a thin shell's physics take it."""

from __future__ import annotations

import numpy as np

from sldvexp.check.base import Examination
from sldvexp.errors import UserError
from sldvexp.shell import SurfaceField
from sldvexp.shell.estimate import reconstruct_surface
from sldvexp.shell.shell import Shell
from sldvexp.typing import Array


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
