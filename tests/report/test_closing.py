"""Five lines close a run: what was found, how good, the verdict, where it lies, what to do next."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from sldvexp.dataset import Finding, RunData, Severity, findings_to_dataset, group
from sldvexp.report import closing_lines, closing_table, image_text, pose_text, print_closing
from sldvexp.report.key_numbers import key_numbers
from sldvexp.report.tables import hot_spot_table, strain_table

FILES = [Path("there/run.nc"), Path("there/pose.txt"), Path("there/report.html")]
LABELS = ["found", "bounds", "verdict", "files", "next"]


def lines(groups, files=FILES):
    made = list(closing_lines(RunData(groups), files))
    assert [label for label, _ in made] == LABELS
    return dict(made)


def verdict(*findings):
    return findings_to_dataset(findings)


def test_a_field_is_told_by_its_largest_velocities_on_the_surface():
    field = group(
        "field",
        {"component": ["x", "z"], "frequency": [100.0, 200.0]},
        element=[[0, 1]],
        velocity=[[[1e-3, 2e-3], [0.0, 0.02j]], [[0.0, 1e-3], [0.0, 0.01]]],
        confidence=np.full((2, 2, 2), 3e-4),
    )
    told = lines({"field": field, "verdict": verdict()})
    assert told["found"] == (
        "velocity on the given surface at 200 Hz, the strongest of 2 frequencies: "
        "x 2.00 ± 0.30, z 20.00 ± 0.30 mm/s"
    )
    of_middle = lines({"field": field.assign_attrs(given_surface="middle"), "verdict": verdict()})
    assert of_middle["found"].startswith("velocity on the middle surface at 200 Hz")
    assert told["bounds"] == "95 %, r.m.s. of them x 0.3, z 0.3 mm/s"
    assert told["verdict"].startswith("trusted: nothing that could be tested speaks against")
    assert told["files"] == "there/run.nc, pose.txt, report.html"
    assert (
        told["next"] == "sldvexp show there tells every number and note; or open there/report.html"
    )


def test_the_worst_finding_stands_beside_the_verdict_and_its_remedy_comes_next():
    sign = Finding("sign", "view a", "view a has the wrong sign", Severity.void, remedy="x=[a]")
    gain = Finding("gain", "view b", "view b is 1.4 times", Severity.doubtful, remedy="x=[b]")
    told = lines({"verdict": verdict(gain, sign, Finding("n", "run", "note", Severity.note))})
    assert told["verdict"] == (
        "void: the bounds cannot be believed: view a has the wrong sign (and 1 more)"
    )
    assert told["next"].startswith("x=[a]; sldvexp show there tells")


def strain_of(hertz, **attrs):
    """The components' bounds, of the larger part, are another quantity than the extension's."""
    known = {} if hertz is None else {"frequency": hertz}
    values = np.array([[1e-6, 2e-6], [0.5e-6, 4.276e-6]])[:, None] * np.ones((1, 3, 1))
    values = values if known else values[..., 1]
    made = group(
        "strain",
        {"strain_component": ["ss", "tt", "st"], "principal": ["first", "second"], **known},
        strain=0.98 * values,
        confidence=np.full(values.shape, 14e-8),
        principal_strain=values[:, :2],
        principal_confidence=np.full(values[:, :2].shape, 9e-8),
        principal_direction=30.0 * np.ones_like(values[:, 0]),
        principal_direction_std=np.ones_like(values[:, 0]),
        position=[[0, 0, 0], [0.1, 0, 0]],
        coordinate=[[0, 0], [0.1, 0]],
        triangle=[[0, 1, 1]],
    )
    return made.assign_attrs(attrs)


def test_the_largest_strain_is_told_with_its_frequency():
    told = lines({"strain": strain_of([197.0, 438.5])})["found"]
    assert told == "strain of the face up to 4.276 ± 0.090 microstrain at 438.5 Hz"
    told = lines({"modes/strain": strain_of([197.0, 438.5])})["found"]
    assert told == "strain of the face up to 4.276 ± 0.090 microstrain in mode 2, at 438.5 Hz"
    told = lines({"strain": strain_of(None)})["found"]
    assert told == "strain of the face up to 4.276 ± 0.090 microstrain"


def test_the_largest_strain_and_the_first_hot_spot_are_told_with_the_same_bound():
    strain = strain_of([197.0, 438.5])
    table = hot_spot_table(strain, [438.5])
    column = next(c for c in table.columns if "largest extension" in str(c.header))
    first = next(iter(column.cells))
    assert f"up to {first} microstrain" in lines({"strain": strain})["found"]


@pytest.mark.parametrize(("std", "taken"), [(0.0, True), (1e-5, False)])
def test_a_thickness_that_is_taken_as_given_is_told_beside_the_strain(std, taken):
    strain = strain_of([197.0, 438.5], thickness=0.003, thickness_std=std)
    told = lines({"strain": strain})["found"]
    said = ", which rests on the thickness, taken as 3 mm"
    assert told == f"strain of the face up to 4.276 ± 0.090 microstrain at 438.5 Hz{said * taken}"
    title = str(strain_table(strain, [438.5]).title)
    end = "; strain of bending is proportional to the thickness, taken as 3 mm"
    assert title.endswith(end) is taken


def test_a_run_that_was_stopped_says_so_first():
    told = lines({"verdict": verdict(Finding("stopped", "run", "stopped there", Severity.note))})
    assert told["found"] == "stopped there"


def test_what_was_expected_and_missed_is_named():
    check = group(
        "check",
        {"quantity": ["a", "b", "c"]},
        passed=np.array([True, False, False]),
    )
    assert lines({"check": check})["bounds"] == "none; expected: 1 of 3 met, not b and 1 more"


def test_images_alone_tell_how_many_pixels_are_flagged():
    image = group("image", {"frequency": [200.0]}, velocity=[[0.01], [0.02j]], flags=[0, 4])
    told = lines({"image/a": image, "image/b": image}, FILES[:1])
    assert told["found"] == "images of 2 views"
    assert told["bounds"] == "none; 2 of 4 pixels flagged"
    assert told["next"] == "sldvexp show there tells every number and note"


@pytest.mark.filterwarnings("error")
def test_motion_is_told_of_the_first_view_that_has_a_good_pixel():
    hertz = [100.0, 200.0, 300.0]
    moving = np.array([[0.01, 0.02, np.nan], [0.03j, 0.04j, np.nan]])
    std = np.full(moving.shape, 1e-4)
    good = group(
        "image", {"frequency": hertz}, velocity=moving, velocity_std=std, flags=[0, 0]
    ).assign_attrs(summary="two pixels")
    dark = good.assign(flags=("pixel", [4, 4]))
    missing = good.assign(velocity=good["velocity"] * np.nan)
    said = "3 frequencies from 100 to 300 Hz, most motion at 200 Hz: r.m.s. 31.6 mm/s"
    for first in (dark, missing):
        run = RunData({"image/a": first, "image/b": good})
        assert lines(run.groups, FILES[:1])["found"] == f"images of 2 views at {said}"
        Console(quiet=True).print(closing_table(run, FILES))
        assert "Image of the view a: two pixels; no pixel is good" in image_text(run)
    told = lines({"image/a": dark}, FILES[:1])
    assert told["found"] == "images of 1 view without a good pixel"
    assert told["bounds"] == "none; 2 of 2 pixels flagged"


def test_what_a_file_says_cannot_act_on_a_terminal(capsys):
    odd = Finding("odd", "run", "seen \x9b2J here", Severity.void)
    print_closing({"verdict": verdict(odd)}, FILES)
    said = capsys.readouterr().out
    assert len(said.splitlines()) == 5
    assert all(line.isprintable() for line in said.splitlines())


def test_show_tells_every_number_of_a_run(sldvexp):
    done = sldvexp("experiment=point")
    assert len(done.out.splitlines()) == 6 + 5
    for given in (done.folder, done.folder / "run.nc"):
        told = sldvexp("show", str(given))
        assert (told.status, told.err) == (0, "")
        assert "point, 450 Hz: V_z" in told.out
        assert "Expected: 1 of 1 met" in told.out
        assert str(done.folder / "run.nc") in told.out


@pytest.mark.parametrize("name", ["", "run.nc"])
def test_show_of_no_run_is_refused_in_a_sentence(sldvexp, tmp_path, name):
    (tmp_path / "x").mkdir()
    done = sldvexp("show", f"{tmp_path}/x/{name}")
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "has no run.nc; give a run, a sweep" in done.err


def test_images_of_many_frequencies_tell_where_most_moves():
    velocity = np.array([[1e-3, 3e-3, 1e-3], [1e-3, 4e-3j, 0.0], [1.0, 0.0, 0.0]])
    hertz = {"frequency": [100.0, 105.0, 110.0]}
    image = group("image", hertz, velocity=velocity, flags=[0, 0, 1])
    pose = group("pose", {"view": ["a"]}, origin=[[0.0, 0.0, 1.0]])
    told = lines({"image/a": image, "pose": pose})["found"]
    assert told == (
        "images of 1 view at 3 frequencies from 100 to 110 Hz, most motion at 105 Hz: "
        "r.m.s. 3.54 mm/s; where the instrument stood in 1 view, without bounds"
    )


def test_a_pose_in_whole_metres_without_bounds_has_none(recwarn):
    pose = group("pose", {"view": ["front"]}, origin=[[0, 0, 1]], euler=[[0, 0, 2]])
    assert lines({"pose": pose})["found"].startswith("where the instrument stood in 1 view")
    row = key_numbers(RunData({"pose": pose})).rows[0]
    assert row[1:] == ["0 (no bound)", "0 (no bound)", "1000 (no bound)"]
    assert "  x0_z =  1.000 (no bound)" in pose_text(pose)
    assert not recwarn.list
