"""Points that a view has not measured are blank, and change nothing elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.reconstruction import Absolute, Combined, Contravariant, Relative

VIEWS, POINTS, FREQUENCIES = 5, 4, 3
METHODS = {
    "absolute": Absolute(),
    "relative": Relative(),
    "combined": Combined(),
    "contravariant": Contravariant(rows="1,2,3"),
}


def measured(std=True):
    rng = np.random.default_rng(3)
    d = rng.normal(size=(VIEWS, POINTS, 3)) * [0.5, 0.5, 0] + [0, 0, 1]
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    v = rng.normal(size=(2, POINTS, 3, FREQUENCIES))
    z = np.einsum("vpa,paf->vpf", d, v[0] + 1j * v[1])
    z = z + 1e-3 * rng.normal(size=z.shape)
    return dataset.group(
        "line_of_sight",
        {
            "view": [str(i + 1) for i in range(VIEWS)],
            "point": list("abcd"),
            "frequency": 100.0 * np.arange(1, FREQUENCIES + 1),
        },
        direction_cosines=d,
        velocity=z,
        **({"velocity_std": rng.uniform(1e-3, 2e-3, z.shape)} if std else {}),
    )


@pytest.mark.parametrize("std", [True, False])
@pytest.mark.parametrize("name", METHODS)
def test_marked_points_are_blank_and_others_the_same(name, std):
    whole = measured(std)
    gone = np.zeros((VIEWS, POINTS, FREQUENCIES), bool)
    gone[1, 2], gone[4, 0, 1] = True, True
    marked = whole.copy(deep=True)
    marked["velocity"].values[gone] = np.nan
    marked["direction_cosines"].values[1, 2] = np.nan
    if std:
        marked["velocity_std"].values[gone] = np.nan
    found = METHODS[name].group(marked)
    # Rows may be chosen by the directions of all points that are solved.
    right = METHODS[name].group(whole.isel(point=[0, 1, 3])).reindex(point=list("abcd"))
    lost = gone.any(axis=0)  # (point, frequency)
    for variable in ("velocity", "velocity_std", "confidence"):
        expected = np.where(lost[:, None], np.nan, right[variable].values)
        np.testing.assert_allclose(found[variable].values, expected, rtol=1e-10)
    assert found["observable"].values.tolist() == [[1] * 3, [1] * 3, [0] * 3, [1] * 3]
    assert found["velocity"].attrs == right["velocity"].attrs


def test_nothing_is_left():
    group = measured()
    group["velocity"].values[0] = np.nan
    with pytest.raises(UserError, match="at every point some view has no velocity"):
        METHODS["absolute"].group(group)
