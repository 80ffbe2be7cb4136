"""Rows of the closing table."""

from __future__ import annotations

import numpy as np
import xarray as xr

from sldvexp import dataset
from sldvexp.report.field_text import field_tables
from sldvexp.report.table import _point_rows, estimates


def test_rows_tell_of_their_own_point_and_frequency():
    velocity = np.ones((2, 3, 2), complex)
    efficiency = np.array([0.9, 0.8, 0.3, 0.2])[:, None].reshape(2, 1, 2) * np.ones((2, 3, 2))
    point = dataset.group(
        "point",
        {"point": ["a", "b"], "frequency": [10.0, 20.0]},
        velocity=velocity,
        confidence=np.full((2, 3, 2), 0.1),
        efficiency=efficiency,
        rcond=[0.5, 0.25],
        observable=np.array([[True, True, True], [True, True, False]]),
    )
    notes = {label: note for label, _, _, note in _point_rows("point", point, 4)}
    assert notes["point, point a, frequency 10: V_z"] == "efficiency 0.9, rcond 0.5"
    assert notes["point, point a, frequency 20: V_z"] == "efficiency 0.8, rcond 0.5"
    assert notes["point, point b, frequency 10: V_x"] == "efficiency 0.3, rcond 0.25"
    assert notes["point, point b, frequency 20: V_x"] == "efficiency 0.2, rcond 0.25"
    assert notes["point, point b, frequency 20: V_z"] == "not determined by these views"
    *_, last = estimates({"point": point}, 3)
    assert last[:2] == ("point: 1 more", "in run.nc, group point")
    assert len(list(estimates({"point": point}, 3))) == 3 * 3 + 1


def test_fields_of_many_frequencies_are_told_of_where_they_are_strongest(small_volume, small_field):
    hertz = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
    field = small_field(small_volume(), hertz=hertz)
    field["velocity"].values[:] *= np.array([9, 1, 8, 2, 7, 6])
    field["velocity"].values[3] = np.nan
    truth = xr.Dataset(
        {
            name: (("component", "frequency"), np.tile(np.array(hertz) / 1e3, (3, 1)))
            for name in ("relative_error", "rms_error", "rms_bound", "covered")
        },
        coords={"component": ["x", "y", "z"], "frequency": list(hertz)},
    )
    _, components, compared = field_tables({"field": field, "examined/truth": truth})
    for table in (components, compared):
        told = {str(c.header): list(c.cells) for c in table.columns}
        assert told["Hz"] == ["10", "30", "50", "60"] * 3
        assert str(table.title).endswith(", the 4 strongest of 6 frequencies")
    assert list(compared.columns[3].cells)[:4] == ["10", "30", "50", "60"]
