"""Plate of four points whose velocities universal files have, and the import of such files."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView
from sldvexp.importers import conventions as settings
from sldvexp.importers.uff import UffImport

POINTS = [[0, 0, 0], [0.15, 0, 0], [0.15, 0.1, 0], [0, 0.1, 0]]
FREQUENCY = 100.0 + 10 * np.arange(5)
#: Values of the first point in the file's unit, as texts have them: with six digits.
FIRST = np.array(
    [
        9.55336e-4 + 2.95520e-4j,
        9.65341e-4 + 5.27368e-4j,
        9.17811e-4 + 7.73061e-4j,
        8.08093e-4 + 1.01832e-3j,
        6.35035e-4 + 1.24769e-3j,
    ]
)
SIX_DIGITS = 5e-6
SAID = {
    "directions": settings.Directions.view,
    "positive": settings.Positive.towards,
    "phase": settings.Phase.exp_plus,
    "reference": 1.0,
}


def read(path, direction=(0.0, 0.0, 1.0), dof="", **more):
    view = PointwiseView(path=str(path), direction=list(direction), dof=dof)
    return UffImport(views={"a": view}, **{**SAID, **more}).read()


def refused(path, *said, **more):
    with pytest.raises(UserError) as error:
        read(path, **more)
    for part in said:
        assert part in str(error.value), str(error.value)
    assert "\n" not in str(error.value)
    return str(error.value)
