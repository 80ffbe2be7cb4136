"""Modes and the verdict on a model: in the line that closes a run, in tables and on the page."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import RunData, group
from sldvexp.plot import figures_of
from sldvexp.report import closing_lines, closing_table
from sldvexp.report.html import modal, results, run_page, shape
from sldvexp.report.html.blocks import (
    Alternatives,
    Beside,
    Figure,
    HtmlTable,
    Listing,
    Shape,
    Text,
)
from sldvexp.report.key_numbers import key_numbers
from sldvexp.report.modal_tables import criteria_table, modal_tables, model_sentences
from tests.report.made_modes import LIMITS, criteria, model, modes, pixels, told_of_model
from tests.report.test_shape import floats


def column(table, name):
    return list(next(c for c in table.columns if c.header == name).cells)


def test_the_line_that_closes_a_run_tells_its_modes_first(tmp_path):
    place = {"origin": [[0, 0, 1]], "origin_confidence": [[2e-4, 1e-4, 2e-4]]}
    groups = {"pose": group("pose", {"view": ["front"]}, **place), "modes": modes()}
    told = dict(closing_lines(RunData(groups), [tmp_path / "run.nc"]))
    assert told["found"] == (
        "3 modes: 197.0000 ± 0.0020 Hz, damping 1.00000 ± 0.00098 %; "
        "439.0000 ± 0.0039 Hz, damping 1.00010 ± 0.00098 %; "
        "545.0000 ± 0.0059 Hz, damping 1.00020 ± 0.00098 %"
    )
    assert told["bounds"] == "95 %"


def test_of_many_modes_the_line_names_five(tmp_path):
    many = {"modes": modes(np.linspace(100.0, 800.0, 8))}
    told = dict(closing_lines(RunData(many), [tmp_path / "run.nc"]))["found"]
    assert told.startswith("8 modes: ")
    assert told.endswith("; 3 more")
    assert told.count(" Hz") == 5


def test_the_line_tells_the_verdict_on_the_model(tmp_path):
    for shapes, frequencies, verdict in (
        ("accepted", "accepted", "accepted"),
        ("accepted", "rejected", "rejected"),
        ("rejected", "undecided", "rejected"),
        ("accepted", "undecided", "undecidable"),
    ):
        run = RunData({"modes": modes(), "model": model(shapes, frequencies)})
        told = dict(closing_lines(run, [tmp_path / "run.nc"]))["found"]
        assert f"; finite element model {verdict} (shapes {shapes}, frequencies " in told


def test_the_first_screen_tells_the_verdict_on_the_model_beside_the_modes():
    rejected = model("accepted", "rejected")
    for groups, said in (
        ({"model": rejected}, ["(shapes accepted, frequencies rejected)"]),
        ({}, []),
    ):
        (lead,) = results.result_section(RunData({"modes": modes(), **groups})).blocks
        at = next(i for i, block in enumerate(lead.told) if isinstance(block, HtmlTable))
        told = [block.text for block in lead.told[at + 1 :]]
        assert told == [f"Finite element model rejected {text}, see Model below." for text in said]


def test_a_run_without_modes_tells_what_it_told_before(tmp_path):
    place = {"origin": [[0, 0, 1]], "origin_confidence": [[2e-4, 1e-4, 2e-4]]}
    run = RunData({"pose": group("pose", {"view": ["front"]}, **place)})
    told = dict(closing_lines(run, [tmp_path / "run.nc"]))
    assert told["found"].startswith("where the instrument stood in 1 view")
    assert list(modal_tables(run)) == []


def test_modes_are_a_table_with_bounds():
    (table,) = modal_tables(RunData({"modes": modes()}))
    assert table.title == "Modes, with 95 % bounds; misfit 1.02 (noise alone: 1; p = 0.3)"
    assert column(table, "natural frequency, Hz")[1] == "439.0000 ± 0.0039"
    assert column(table, "damping, %")[2] == "1.00020 ± 0.00098"
    assert column(table, "complexity, ‰")[0] == "0.200 ± 0.020"
    assert column(table, "phase, deg")[0] == "0.573"
    (table,) = modal_tables(RunData({"modes": modes().assign(phase_std=("mode", [1e-3] * 3))}))
    assert column(table, "phase, deg")[0] == "0.57 ± 0.11"


def test_the_modal_scale_is_told_where_the_reference_is_known():
    scaled = modes().assign(modal_scale=("mode", [2e-3, 3e-3, np.nan]))
    scaled["modal_scale_std"] = "mode", [1e-5, 1e-5, np.nan]
    (table,) = modal_tables(RunData({"modes": scaled}))
    assert column(table, "modal scale, mm/s")[:2] == ["2.000 ± 0.020", "3.000 ± 0.020"]
    scaled["modal_scale"] = "mode", [np.nan] * 3
    (table,) = modal_tables(RunData({"modes": scaled}))
    assert "modal scale, mm/s" not in [c.header for c in table.columns]


def test_no_mode_found_is_said_and_makes_an_empty_table(tmp_path):
    run = RunData({"modes": modes(np.empty(0))})
    assert dict(closing_lines(run, [tmp_path / "run.nc"]))["found"] == "no modes"
    (table,) = modal_tables(run)
    assert table.row_count == 0
    assert "stabilisation" in figures_of(run)


def test_a_model_is_a_table_of_pairs_with_the_tests():
    _, table = modal_tables(RunData({"modes": modes(), "model": model("rejected")}))
    assert table.title == (
        "Finite element model: rejected (shapes rejected, frequencies accepted); "
        "frequencies together p = 0.84"
    )
    assert column(table, "pair") == ["1", "2", "none"]
    assert column(table, "difference, ‰") == ["-1", "+2", ""]
    assert column(table, "MAC")[0] == "0.9999000"
    assert column(table, "expected if right")[0] == "0.9999100 ± 0.0000020"
    assert column(table, "shape p") == ["0.4", "1e-09", ""]
    assert column(table, "mixed with") == ["", "3 (2 %)", ""]


def test_criteria_by_pixel_and_line_stand_beside_those_of_noise_alone():
    of = criteria(short=20.0)
    worst = of["model/image/right"]
    worst["comac"][3] = 0.9
    table = criteria_table(RunData(of))
    assert column(table, "criterion") == ["CoMAC", "FRAC", "CSAC"]
    median, noise = (list(map(float, column(table, n))) for n in ("median", "noise alone"))
    assert [0.996 < m < 0.9985 for m in median] == [True] * 3
    assert [0.9998 < n < 0.9999 for n in noise] == [True] * 3
    assert column(table, "worst")[0] == "0.900000"
    where = column(table, "at")
    assert where[0] == "view right, pixel 5"
    assert where[2].endswith(" Hz")
    tables = list(modal_tables(RunData({"modes": modes()} | of)))
    assert tables[-1].title == "Model by pixel and by line, not judged"
    blocks = modal.model_section(RunData({"modes": modes()} | of)).blocks
    assert tables[-1].title in [b.caption for b in blocks if isinstance(b, HtmlTable)]
    assert "model_criteria" in figures_of(RunData(of))


def test_a_run_without_lines_has_no_criteria_by_line():
    of = criteria()
    of["model"] = model()
    assert column(criteria_table(RunData(of)), "criterion") == ["CoMAC", "FRAC"]
    assert criteria_table(RunData({"model": model()})) is None


def test_a_p_value_below_all_numbers_is_not_zero():
    tested = model("rejected", "rejected")
    tested["p_value"][1] = 0.0
    tested["frequencies_p_value"] = 0.0
    _, table = modal_tables(RunData({"modes": modes(), "model": tested}))
    assert column(table, "shape p") == ["0.4", "< 1e-300", ""]
    assert str(table.title).endswith("; frequencies together p < 1e-300")


def test_what_cannot_be_told_of_a_model_is_its_last_sentence():
    told = model_sentences(RunData({"model": model(), "verdict": told_of_model()}))
    assert told == ["The shapes are those measured.", f"I{LIMITS[1:]}."]


def test_tables_of_modes_and_model_come_before_all_others(capsys, tmp_path):
    line = np.linspace(100.0, 700.0, 256)
    lines = {"velocity": np.ones((2, 256)), "velocity_std": np.full((2, 256), 1e-3)}
    image = group("image", {"frequency": line}, flags=[0, 0], **lines)
    image = image.assign_attrs(summary="0 of 2 pixels are flagged")
    closing_table({"image/a": image, "modes": modes(), "model": model()}, [tmp_path / "run.nc"])
    told = capsys.readouterr().out
    assert 0 <= told.index("Modes, with 95 %") < told.index("Finite element model: accepted")
    assert "Image of the view a" not in told[: told.index("Finite element model")]


def test_key_numbers_of_modes_are_their_poles():
    key = key_numbers(RunData({"modes": modes(), "field": group("field", {})}))
    assert key.title == "Modes, with 95 % bounds"
    assert key.rows[0] == ["1", "197.0000 ± 0.0020", "1.00000 ± 0.00098"]


def test_the_page_has_a_section_of_modes_and_one_of_the_model():
    run = RunData({"modes": modes(), "model": model("rejected"), "verdict": told_of_model()})
    found, tested = modal.modes_section(run), modal.model_section(run)
    assert [type(block) for block in found.blocks] == [HtmlTable, Text, Figure]
    assert (found.title, tested.title) == ("Modes", "Model")
    assert tested.blocks[0].tone == "warning"
    (listing,) = (block for block in tested.blocks if isinstance(block, Listing))
    assert listing.items[-1].startswith("Its shapes say nothing of E")
    assert run_page._title(run) == "3 modes and a finite element model put to the test"


def test_a_run_without_modes_has_no_such_sections():
    run = RunData({})
    assert modal.modes_section(run) is modal.model_section(run) is None


def test_measured_and_computed_shapes_stand_beside_each_other_at_the_pixels():
    groups = {"modes": modes(), "model": model()} | pixels()
    (beside,) = (b for b in modal.model_section(RunData(groups)).blocks if isinstance(b, Beside))
    (measured,), (computed,) = beside.columns
    of = groups["model/image/right"]  # which sees more pixels of the model
    for drawn, velocity in (
        (measured, of["velocity"] + of["residual"]),
        (computed, of["velocity"]),
    ):
        assert drawn.data["numbers"] == [1, 2]  # the third has no pair
        assert drawn.data["frequencies"] == [197.0, 439.0]
        real = floats(drawn.data["real"]).reshape(2, 9)
        np.testing.assert_allclose(real, velocity.T.real, rtol=1e-6)
    std = groups["modes/image/right"]["velocity_std"].values[2:11, :2]
    bound = floats(measured.data["bound"]).reshape(2, 9)
    np.testing.assert_allclose(bound, 1.959964 * std.T, rtol=1e-5)
    assert np.isnan(floats(computed.data["bound"])).all()


def test_mode_shapes_are_shown_first_and_the_lines_can_be_chosen(
    small_volume, small_field, no_figures
):
    around = small_volume()
    lines, shapes = small_field(around), small_field(around, hertz=(197.0, 439.0, 545.0))
    run = RunData({"volume": around, "field": lines, "modes/field": shapes})
    (choice,) = results.shape_blocks(run)
    assert isinstance(choice, Alternatives)
    first, second = (column[0] for column in choice.columns)
    assert (first.name, second.name) == ("shape-modes", "shape")
    assert first.data["numbers"] == [1, 2, 3]
    assert "numbers" not in second.data
    assert first.data["frequencies"] == [197.0, 439.0, 545.0]


def test_shapes_of_modes_and_lines_share_the_room_of_a_page(
    small_volume, small_field, no_figures, monkeypatch
):
    around = small_volume()
    lines, shapes = small_field(around, hertz=tuple(range(100, 160))), small_field(around)
    run = RunData({"volume": around, "field": lines, "modes/field": shapes})
    monkeypatch.setattr(shape, "MOST_BYTES", 20_000)
    (choice,) = results.shape_blocks(run)
    both = [column[0].data for column in choice.columns]
    numbers = {k: both[1][k] for k in ("real", "imaginary", "bound", "layers")}
    assert shape.size_of(both[0]) + shape.size_of(numbers) <= 20_000
    assert both[0]["left_out"] == 0 < both[1]["left_out"]


@pytest.mark.parametrize("modal", [False, True], ids=["lines", "modes"])
def test_a_surface_without_triangles_is_said_to_be_one(
    small_volume, small_field, no_figures, modal
):
    around = small_volume()
    field = small_field(around)
    around = around.isel(element=slice(0))
    field = field.isel(element=slice(0))
    run = RunData({"volume": around, "field": field} | ({"modes/field": field} if modal else {}))
    assert results.shape_blocks(run) == [Text(results.NO_TRIANGLES)]
    assert Text(results.NO_TRIANGLES) in results.result_section(run).blocks[0].shown


def test_a_run_without_mode_shapes_has_its_one_shape(small_volume, small_field, no_figures):
    around = small_volume()
    run = RunData({"volume": around, "field": small_field(around)})
    assert [type(block) for block in results.shape_blocks(run)] == [Shape, Text]
