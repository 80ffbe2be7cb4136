"""Tables of strain and of hot spots, on the terminal and on the page."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from sldvexp.dataset import RunData
from sldvexp.report.html import figures, run_page
from sldvexp.report.html.blocks import HtmlTable
from sldvexp.report.tables import field_tables, strain_tables
from tests.shell.made_strain import made_strain


def column(table, name):
    return list(next(c for c in table.columns if c.header == name).cells)


def test_hot_spots_are_listed_by_frequency_with_place_value_and_bound(small_volume):
    strain = made_strain(small_volume())
    components, spots = strain_tables(RunData({"strain": strain}))
    assert column(components, "strain") == ["e_ss", "e_ss", "e_tt", "e_tt", "e_st", "e_st"]
    assert float(column(components, "r.m.s. of bending")[0]) == pytest.approx(
        0.9 * float(column(components, "r.m.s.")[0]), rel=0.01
    )
    assert column(spots, "no.") == ["1", "1", "2"]
    assert column(spots, "Hz") == ["197", "439", "439"]
    place = int(strain["von_mises"].values[:, 0].argmax())
    x, y, z = 1e3 * strain["position"].values[place]
    assert column(spots, "x, y, z, mm")[0] == f"{x:g}, {y:g}, {z:g}"
    assert "±" in column(spots, "von Mises, MPa")[0]
    assert column(spots, "its direction from t1, deg")[0].split(" ± ")[0].startswith("13.")


def test_strains_of_compared_methods_have_tables_of_their_own(small_volume):
    strain = made_strain(small_volume())
    run = RunData({"compare_strain/spline": strain})
    assert [str(t.title).partition(",")[0] for t in strain_tables(run)] == [
        "Strain of the face by spline",
        "Hot spots of the face by spline",
    ]


def test_names_of_methods_are_no_marks_in_titles(small_volume):
    run = RunData({"compare_strain/[/b]": made_strain(small_volume())})
    for table in strain_tables(run):
        assert "of the face by [/b]" in HtmlTable.from_table(table).caption
        Console(file=StringIO()).print(table)


def test_without_a_material_no_stress_is_listed(small_volume):
    _, spots = strain_tables(RunData({"strain": made_strain(small_volume(), stress=False)}))
    assert "von Mises, MPa" not in [c.header for c in spots.columns]


def test_a_run_without_strain_has_no_such_tables(small_volume, small_field):
    run = RunData({"field": small_field(small_volume())})
    assert list(strain_tables(run)) == []
    assert not any("Strain" in str(t.title) for t in field_tables(run))


def test_a_page_has_a_section_on_strain(run_file, small_volume, monkeypatch):
    monkeypatch.setattr(figures, "_address", lambda _: "data:,")
    strain = made_strain(small_volume())
    path = run_file(strain=strain, **{"compare_strain/spline": strain})
    page = run_page.write(path, path.with_name("report.html")).read_text()
    assert '<a href="#strain">Strain</a>' in page
    for of in ("", " by spline"):
        assert page.count(f"<h3>Hot spots of the face{of}</h3>") == 1
    for caption in figures.PARTS["strain"].values():
        assert caption in page
    assert "Colours of strains are those of the drawn surface" in page
