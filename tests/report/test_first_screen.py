"""A page begins with what came out; what did not come to an end has a page too."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import sldvexp.plot
from sldvexp import dataset
from sldvexp.dataset import Finding, RunData, Severity, findings_to_dataset
from sldvexp.report.html import diagnostics, run_page, sweep_page, unfinished
from sldvexp.report.html.blocks import Listing
from sldvexp.report.html.page import Html
from sldvexp.report.key_numbers import key_numbers, on_surface
from sldvexp.report.tables import field_tables, truth_table
from sldvexp.report.terminal import closing_table, estimates
from sldvexp.session.interruption import how_to_go_on, how_to_use_the_scan
from sldvexp.sweep import ranking
from tests.report.test_html_page import Page

#: What only a program says.
OF_PROGRAMS = re.compile(
    r"\b(nan|None|True|False|inf|Traceback|Error|dtype|ndarray)\b|<class|\+- nan"
)


def page_of(path) -> Page:
    page = path.with_name("report.html")
    run_page.write(path, page)
    return Page(page.read_text())


def numbers_of(text):
    return [float(word) for word in re.findall(r"\d+\.\d+", text)]


def test_key_numbers_are_those_of_the_surface_and_not_of_the_volume(run_file, no_figures):
    with dataset.load(run_file()) as tree:
        run = RunData.from_source(tree)
        field = run.groups["field"].load().copy(deep=True)
        volume = run.groups["volume"].load()
    field["velocity"].values[:20] *= 10  # of the layer below, that no picture shows
    run = RunData({"volume": volume, "field": field})
    surface = on_surface(run, field)
    assert surface.sizes["node"] == 20
    np.testing.assert_array_equal(surface["position"].values[:, 2], 0.0)
    shown = key_numbers(run)
    assert shown is not None
    assert shown.title == "Velocity on the given surface at 197 Hz, the strongest of 2 frequencies"
    size = 1e3 * np.abs(surface["velocity"].values[:, :, 0])
    for row, own in zip(shown.rows, size.T, strict=True):
        assert numbers_of(row[1])[0] == pytest.approx(own.max(), rel=1e-2)
        assert float(row[2]) == pytest.approx(np.sqrt(np.mean(own**2)), rel=5e-3)
    table = next(t for t in field_tables(run) if "Velocity" in str(t.title))
    assert str(table.title) == "Velocity on the given surface, mm/s"
    largest = [numbers_of(cell)[0] for cell in list(table.columns[3].cells)[::2]]
    assert largest == [numbers_of(row[1])[0] for row in shown.rows]


def test_what_is_not_above_its_bound_says_so(small_volume, small_field):
    volume = small_volume()
    field = small_field(volume, hertz=(197.0,))
    field["velocity"].loc[{"component": "y"}] = 1e-5
    field["confidence"].loc[{"component": "y"}] = 2e-4
    run = RunData({"volume": volume, "field": field})
    rows = {row[0]: row[1] for row in key_numbers(run).rows}
    assert rows["y"] == "not above its bound, ± 0.20"
    assert "±" in rows["z"]
    table = next(t for t in field_tables(run) if "Velocity" in str(t.title))
    assert list(table.columns[3].cells)[1] == "not above its bound"
    assert list(table.columns[4].cells)[1] == "0%"


def test_an_error_relative_to_noise_is_not_told():
    numbers = {"relative_error": [0.78, 0.01], "rms_error": [1e-5, 1e-5], "rms_bound": [2e-5] * 2}
    truth = dataset.group(
        "examined/truth", {"component": ["x", "z"]}, **numbers, covered=[1.0, 1.0]
    )
    cells = list(truth_table(truth, [np.nan]).columns[2].cells)
    assert cells == ["not above its bound", "1.00%"]


def test_verdict_and_key_numbers_come_before_the_shape_and_all_else(run_file, no_figures):
    text = run_file().with_name("report.html")
    page = page_of(run_file())
    raw = text.read_text()
    assert page.sections[0] == "result"
    first = raw[raw.index('<section id="result"') : raw.index('<section id="what-to-mind"')]
    assert first.index('class="verdict') < first.index("Velocity on the given surface")
    assert first.index("Velocity on the given surface") < first.index('class="shape"')
    assert raw.count('id="shape-canvas"') == 1


def test_a_warning_that_is_a_finding_is_said_once(run_file, no_figures, capsys):
    told = "the tripod was moved between the scans"
    verdict = findings_to_dataset([Finding("moved", "view left", told, Severity.doubtful)])
    volume_note = dataset.group("point", {}, velocity=[1.0, 0, 0], confidence=[0.1] * 3)
    volume_note.attrs["notes"] = told
    page = page_of(run_file(verdict=verdict, point=volume_note))
    assert page.text.count(told) == 1
    closing_table({"verdict": verdict, "point": volume_note}, [])
    assert " ".join(capsys.readouterr().out.split()).count(told) == 1


@pytest.mark.parametrize(
    ("severity", "noted", "told"),
    [
        (Severity.note, True, "1 note and 1 thing to mind, below."),
        (Severity.doubtful, True, "1 finding and 1 thing to mind, below."),
        (Severity.doubtful, False, "1 finding, below."),
        (None, True, "1 thing to mind, below."),
    ],
)
def test_the_verdict_counts_all_that_stands_below(severity, noted, told):
    told_of = [] if severity is None else [severity]
    findings = [Finding("moved", "view left", "it was moved", s) for s in told_of]
    groups = {"verdict": findings_to_dataset(findings)} if findings else {}
    point = dataset.group("point", {}, velocity=[1.0, 0, 0], confidence=[0.1] * 3)
    point.attrs["notes"] = "poses have no covariance" if noted else ""
    run = RunData({**groups, "point": point})
    (lead,) = diagnostics.verdict_blocks(run)
    assert lead.text.endswith(told)
    listed = [b for b in diagnostics.findings_section(run).blocks if isinstance(b, Listing)]
    assert sum(len(block.items) for block in listed) == len(findings) + noted


def test_points_in_a_table_are_those_that_move_most():
    rng = np.random.default_rng(3)
    velocity = 1e-6 * rng.normal(size=(5000, 3)) + 0j
    velocity[4321] = 0.02
    names = {"point": np.arange(5000)}
    point = dataset.group("point", names, velocity=velocity, confidence=np.full((5000, 3), 1e-7))
    rows = list(estimates(RunData({"point": point}), most=16))
    assert any("point 4321" in row[0] and row[1].startswith("20.0") for row in rows)
    assert len([row for row in rows if "V_" in row[0]]) == 48


def test_lines_that_join_nothing_are_not_said_to_join(run_file, small_points, no_figures):
    point, ends = small_points
    told = "Points are joined as their file says"
    for lines, joined in ((ends, True), (ends.isel(triangle=slice(0), line=slice(0)), False)):
        with dataset.load(run_file()) as tree:
            attributes = dict(tree.attrs)
        path = run_file().with_name("run.nc")
        dataset.save({"point": point, "line_of_sight": lines}, attributes, path)
        assert (told in page_of(path).text) is joined


def test_pages_have_no_words_of_a_program(run_file, small_points, no_figures):
    point, ends = small_points
    bare = point.drop_vars("velocity_std").copy(deep=True)
    bare["velocity"].values[2] = np.nan
    bare["confidence"].values[2] = np.nan
    pages = [page_of(run_file()), page_of(run_file(point=bare, line_of_sight=ends))]
    for page in pages:
        body = page.text.partition("The whole configuration")[0]
        assert OF_PROGRAMS.findall(body) == []


@pytest.fixture
def cut_off(tmp_path):
    return interrupted_run(tmp_path / "cut")


def interrupted_run(folder: Path) -> Path:
    """Make the folder of a run that was interrupted in its second view."""
    for name in ("1/1_fine_000.npz", "1/image_000.npz", "2/1_coarse_000.npz"):
        file = folder / "journal" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"")
    (folder / ".hydra").mkdir()
    (folder / ".hydra/config.yaml").write_text("seed: 3\n")
    (folder / ".hydra/overrides.yaml").write_text("- experiment=session\n- seed=3\n")
    steps = ("calibration object", "scan")
    start = "[2026-01-02 03:04:0{},123][sldvexp.pipeline.runner][INFO] - {}"
    (folder / "sldvexp.log").write_text("\n".join(start.format(*s) for s in enumerate(steps)))
    return folder


def test_an_interrupted_run_has_a_page_of_what_there_is_and_how_to_go_on(cut_off):
    page = Html().of_unfinished(cut_off)
    text = Page(page.read_text()).text
    assert "Interrupted run: there is no result yet." in text
    assert f"sldvexp resume={cut_off}" in text
    assert "2026-01-02 03:04:00 calibration object done" in text
    assert "2026-01-02 03:04:01 scan not finished" in text
    assert re.search(r"1 0 1 1 0 2 1 0 0 0", text)  # files of each view by kind
    assert "sldvexp experiment=session seed=3" in text
    assert unfinished.unfinished_because(cut_off.parent) != ""


def test_a_failed_run_says_why(cut_off):
    reason = "laser.reg, line 3: there is no point 9"
    text = Page(Html().of_unfinished(cut_off, reason).read_text()).text
    assert "Failed run: there is no result yet." in text
    assert text.count("Laser.reg, line 3: there is no point 9") == 1
    assert "instrument=replay" in text


def test_what_a_page_tells_by_itself_is_not_in_its_sentence_too(cut_off):
    reason = f"interrupted; {how_to_go_on(cut_off)}"
    text = Page(Html().of_unfinished(cut_off, reason).read_text()).text
    told = text.partition("Log")[2].partition(" Log ")[0]
    assert told.count(f"sldvexp resume={cut_off}") == 1
    reason = f"volume: it is nowhere; {how_to_use_the_scan(cut_off)}"
    text = Page(Html().of_unfinished(cut_off, reason).read_text()).text
    first, resumed, again = (
        text.index(part)
        for part in (
            "Volume: it is nowhere. The scan is kept.",
            f"sldvexp resume={cut_off}",
            f"sldvexp experiment=session seed=3 instrument=replay instrument.path={cut_off}",
        )
    )
    assert first < resumed < again < text.index("calibration object")


def test_the_command_makes_the_page_of_a_run_without_a_dataset(sldvexp, cut_off):
    done = sldvexp("report", str(cut_off))
    assert (done.status, done.err, done.out) == (0, "", f"{cut_off / 'report.html'}\n")


def test_a_run_that_fails_leaves_its_page(sldvexp, tmp_path):
    (tmp_path / "bad.reg").write_text("no registration\n")
    done = sldvexp("experiment=pose", "pose.path=bad.reg", "hydra.run.dir=here")
    assert done.status == 1
    text = Page((tmp_path / "here/report.html").read_text()).text
    assert "Failed run" in text
    assert "bad.reg, line 1" in text
    assert done.err.count("\n") == 1


def swept(**results):
    known = {"state": ("pose", ["done", "failed"]), "reason": ("pose", ["", "no points"])}
    known |= {"seconds": ("pose", [1.0, np.nan]), "verdict": ("pose", ["trusted", ""])}
    table = xr.Dataset(
        {name: ("pose", values) for name, values in results.items()} | known,
        {"pose": ["edge", "bitangent"]},
    )
    return table.assign_attrs(keys=["pose"], ranked_by=next(iter(results)))


def test_a_sweep_whose_key_is_the_begin_of_a_results_name_is_drawn_and_told(tmp_path):
    """``pose.s_std`` is no attribute of the coordinate ``pose``."""
    table = swept(**{"pose.s": [0.7, np.nan]})
    assert sldvexp.plot.sweep(table).axes[0].get_ylabel() == "pose.s"
    dataset.save_table(table, tmp_path / "sweep.nc")
    rows = ranking.rows(table, ["pose"], "pose.s")
    page = sweep_page.write(tmp_path / "sweep.nc", rows, tmp_path / "report.html")
    text = Page(page.read_text()).text
    assert "Of 2 runs: 1 done, 1 failed." in text
    assert "could not be drawn" not in text
    assert "pose=bitangent: failed: no points" in text
    assert text.count("failed not done; the reason stands above") == 1


def test_a_sweeps_table_has_the_unit_of_its_figure(tmp_path):
    table = swept(**{"field.residual_std": [4e-5, np.nan]})
    table["field.residual_std"].attrs["units"] = "m/s"
    dataset.save_table(table, tmp_path / "sweep.nc")
    rows = ranking.rows(table, ["pose"], "field.residual_std")
    page = sweep_page.write(tmp_path / "sweep.nc", rows, tmp_path / "report.html")
    text = Page(page.read_text()).text
    assert "field.residual_std, µm/s seconds" in text
    assert "1 edge 40 1 trusted done" in text
    assert sldvexp.plot.sweep(table).axes[0].get_ylabel() == "field.residual_std, µm/s"
    assert "report.each_run=true" in text  # no run has a page


def test_zeros_rank_nothing():
    table = swept(**{"field.residual_std": [0.0, 0.0], "pose.s": [0.7, 0.6]})
    assert ranking.ranked_by(table) == "pose.s"
    assert ranking.ranked_by(table, "field.residual_std") == "field.residual_std"
