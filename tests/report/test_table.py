"""Rows of the closing table."""

from __future__ import annotations

import numpy as np
import xarray as xr
from rich.console import Console

from sldvexp import dataset
from sldvexp.dataset import RunData
from sldvexp.report import estimates, field_tables, notes
from sldvexp.report import terminal as closing
from sldvexp.report.terminal import _point_rows


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
    assert notes["point, point a, 10 Hz: V_z"] == "efficiency 0.9, rcond 0.5"
    assert notes["point, point a, 20 Hz: V_z"] == "efficiency 0.8, rcond 0.5"
    assert notes["point, point b, 10 Hz: V_x"] == "efficiency 0.3, rcond 0.25"
    assert notes["point, point b, 20 Hz: V_x"] == "efficiency 0.2, rcond 0.25"
    assert notes["point, point b, 20 Hz: V_z"] == "not determined by these views"
    *_, last = estimates(RunData({"point": point}), 3)
    assert last[:2] == ("point: 3 more", "in run.nc, group point")
    assert len(list(estimates(RunData({"point": point}), 3))) == 3 * 3 + 1


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
    _, components, compared = field_tables(RunData({"field": field, "examined/truth": truth}))
    for table in (components, compared):
        told = {str(c.header): list(c.cells) for c in table.columns}
        assert told["Hz"] == ["10", "30", "50", "60"] * 3
        assert str(table.title).endswith(", the 4 strongest of 6 frequencies")
    assert list(compared.columns[3].cells)[:4] == ["10", "30", "50", "60"]


def test_what_is_determined_along_no_axis_is_told_with_its_direction():
    nan = np.nan
    across = [[1, 0, 0], [0, -0.6, 0.8], [0, 0.8, 0.6]]
    point = dataset.group(
        "point",
        {"point": ["a", "b"], "frequency": [10.0, 20.0]},
        velocity=np.array([[[1j, 2j]] * 3, [[3, 4], [nan, nan], [nan, nan]]]),
        confidence=np.full((2, 3, 2), 0.1),
        observable=np.array([[True, True, True], [True, False, False]]),
        deficient_point=[1],
        observed_rank=[2],
        observed_direction=np.array([across]),
        observed_velocity=np.array([[[3, 4], [5, 6j], [nan, nan]]]),
        observed_confidence=np.array([[[0.1, 0.1], [0.2, 0.3], [nan, nan]]]),
    )
    rows = {row[0]: row[1:] for row in estimates(RunData({"point": point}))}
    along = {label: row for label, row in rows.items() if "along" in label}
    label = "point, point b, {} Hz: V along (0.00, -0.60, 0.80)"
    about = ("mm/s", "determined by these views")
    assert along == {
        label.format(10): ("5000 ± 200", *about),
        label.format(20): ("0 + 6000i ± 300", *about),
    }


def test_a_note_names_its_results_unless_it_is_of_all():
    def noted(*notes):
        return xr.Dataset(attrs={"notes": "\n".join(notes)})

    tree = {
        "pose": noted("no covariance"),
        "field": noted("of all", "coarse by 2"),
        "compare/relative": noted("of all", "coarse by 3"),
        "compare/combined": noted("of all", "coarse by 3"),
    }
    assert notes(RunData(tree)) == [
        "no covariance",
        "of all",
        "field: coarse by 2",
        "relative, combined: coarse by 3",
    ]
    del tree["compare/relative"], tree["compare/combined"]
    assert notes(RunData(tree)) == ["no covariance", "of all", "coarse by 2"]


def test_expectations_on_a_terminal_of_80_columns_are_whole(monkeypatch, capsys):
    check = dataset.group(
        "check",
        {"quantity": ["truth: examined/truth/relative_error[component=z]"]},
        published=[-1.8153e-05],
        computed=[2.7391e-07],
        correct=[1.2345e-06],
        tolerance=[0.0024],
        relation=["<="],
        passed=[True],
        source=["Section 5.4"],
    )

    class Narrow(Console):
        is_terminal = True

    monkeypatch.setattr(closing, "Console", lambda **_: Narrow(width=80, color_system=None))
    closing.closing_table({"check": check}, [])
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) <= 80
    for whole in ("-1.8153e-05", "2.7391e-07", "1.2345e-06", "relative_error", "[component=z]"):
        assert whole in told
    assert "more column" in told  # and what has no room is not cut, but told of
    assert "run.nc: " in told


def test_texts_of_files_do_not_act_on_the_terminal(capsys):
    image = dataset.group(
        "image", {"frequency": [200.0]}, velocity=[[0.01]], velocity_std=[[1e-4]], flags=[0]
    ).assign_attrs(summary="all \x1b]0;of\x07 use [red]", notes="seen \x9b2J")
    closing.closing_table({"image/front": image}, [])
    out = capsys.readouterr().out
    assert r"all \x1b]0;of\x07 use [red]" in out
    assert r"seen \x9b2J" in out
    assert all(line.isprintable() for line in out.splitlines())
