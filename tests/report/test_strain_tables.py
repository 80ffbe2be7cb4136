"""Tables of strain and of hot spots, on the terminal and on the page."""

from __future__ import annotations

import pytest

from sldvexp.dataset import RunData
from sldvexp.report.html import figures, run_page
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


def test_without_a_material_no_stress_is_listed(small_volume):
    _, spots = strain_tables(RunData({"strain": made_strain(small_volume(), stress=False)}))
    assert "von Mises, MPa" not in [c.header for c in spots.columns]


def test_a_run_without_strain_has_no_such_tables(small_volume, small_field):
    run = RunData({"field": small_field(small_volume())})
    assert list(strain_tables(run)) == []
    assert not any("Strain" in str(t.title) for t in field_tables(run))


def test_a_page_has_a_section_on_strain(run_file, small_volume, monkeypatch):
    monkeypatch.setattr(figures, "_address", lambda _: "data:,")
    path = run_file(strain=made_strain(small_volume()))
    page = run_page.write(path, path.with_name("report.html")).read_text()
    assert '<a href="#strain">Strain</a>' in page
    assert page.count("<h3>Hot spots of the face</h3>") == 1
    for caption in figures.PARTS["strain"].values():
        assert caption in page
    assert "Colours of strains are those of the drawn surface" in page
