"""`sldvexp aim`: points to DAC steps and back, for poses of runs and of settings."""

from __future__ import annotations

import re

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.cli.aim import of_run
from sldvexp.geometry import rotation_from_vector
from sldvexp.laser import dac_of_points

POSES = (
    "pose.views={front: {origin: [0.45, 0.1, 2], look_at: [0.45, 0.1, 0]}, "
    "left: {origin: [-700, 100, 1500], look_at: [450, 100, 0], unit: mm}}"
)
GIVEN = ("~experiment", "pose=given", POSES)
NUMBER = r"(-?[\d.]+)"


def numbers(text: str, pattern: str) -> np.ndarray:
    """Numbers behind the first match of a pattern, whose `#` stand for them."""
    found = re.search(re.escape(pattern).replace(r"\#", NUMBER), text)
    assert found, (pattern, text)
    return np.array([float(x) for x in found.groups()])


def test_a_point_becomes_steps_and_steps_a_point(sldvexp):
    done = sldvexp("aim", *GIVEN, "view=left", "at=0.8,0.3,0.0")
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith(
        "view left, its pose as pose=given has it, at (-0.70000, 0.10000, 1."
    )
    up_down, left_right = numbers(done.out, "dac # #, mirrors")
    steps = f"dac={up_down:.0f},{left_right:.0f}"
    back = sldvexp("aim", *GIVEN, "view=left", "unit=mm", steps).out
    assert numbers(back, "meets the plane z = 0: (#, #, #) mm") == pytest.approx(
        [800, 300, 0], abs=0.3
    )
    mirrors = numbers(done.out, "mirrors # # deg, # m away")
    assert mirrors[:2] == pytest.approx(numbers(back, "mirrors # # deg"), abs=0.004)
    assert mirrors[2] == pytest.approx(np.linalg.norm([1.5, 0.2, 1.5]), abs=1e-3)


def test_all_views_are_told_with_circles_and_corners(sldvexp):
    scan = (
        "scan=session",
        "scan.poses={front: {origin: [0.3, 0.1, 2], look_at: [0.3, 0.1, 0]}}",
        "scan.structure={corners_at: [[30, 0, 0], [60, 0, 0], [60, 20, 0]], unit: cm, stride: 9}",
    )
    done = sldvexp("aim", *GIVEN, *scan, "target=dissertation", "volume=grid", "unit=mm")
    assert done.status == 0, done.err
    front, left = done.out.split("view left")
    assert front.startswith(
        "view front, its rough pose of the scan, at (300.00, 100.00, 2000.00) m"
    )
    for number in (1, 2, 3, 4):
        assert f"  circle {number} (" in front
        assert f"  circle {number} (" in left
    assert "  corners_at, point 3 (600.00, 200.00, 0.00) mm: dac 469 -" in front
    lower_left, upper_right = (numbers(front, f"corner {k} dac # #") for k in (1, 3))
    assert lower_left[0] < upper_right[0]
    assert lower_left[1] > upper_right[1]  # steps grow to the left
    assert "corner" not in left
    assert "  surface of the volume from (" in front


def test_marks_are_listed_that_a_scan_by_hand_has_of_its_own(sldvexp):
    scan = (
        "scan=by_hand",
        "scan.fiducials={3: {x: 0, y: 0}, 7: {x: 300, y: 0}, 9: {x: 0, y: 200}}",
        "scan.unit=mm",
        "scan.views={front: {pose: {origin: [0.3, 0.0, 2], look_at: [0.3, 0, 0]}}}",
    )
    done = sldvexp("aim", "~experiment", *scan)
    assert (done.status, done.err) == (0, "")
    assert "  mark 7 (0.30000, 0.00000, 0.00000) m: dac 0 0, mirrors" in done.out
    assert done.out.count("mark") == 3


def test_what_the_beam_cannot_reach_is_said_in_its_line(sldvexp):
    done = sldvexp("aim", *GIVEN, "view=front", "at=5,0,0", "at=0,0,3", "at=0.45,0.1,0")
    far, behind, here = done.out.splitlines()[1:]
    assert "(5.00000, 0.00000, 0.00000) m: it is out of reach: the left_right angle of " in far
    assert "it lies behind the instrument; correct the pose of the view, or the point" in behind
    assert "dac 0 0, mirrors" in here


@pytest.mark.whole
def test_bounds_of_a_run_in_steps_are_those_of_its_poses(sldvexp):
    run_folder = sldvexp("experiment=pose", "report=none", "check={}", "expect={}").folder
    (view,), around = of_run(run_folder)
    point = np.array([0.2, 0.15, 0.0])
    steps = dac_of_points(point[None], view.rotation, view.origin, around.laser, ["p"])[0]
    rng = np.random.default_rng(0)
    drawn = rng.multivariate_normal(np.zeros(6), view.covariance, 4000)
    others = np.array(
        [
            dac_of_points(
                point[None], rotation_from_vector(d[:3]) @ view.rotation, view.origin + d[3:],
                around.laser, ["p"],
            )[0]
            for d in drawn
        ]
    )  # fmt: skip
    bounds = view.bounds(point, around.laser)
    # Student's t of the pose's degrees of freedom is a little wider; 4000 draws tell to 2.5 %.
    with dataset.load(run_folder / "run.nc") as tree:
        dof = float(tree["pose"]["dof"][0])
    ratio = bounds / (1.96 * (others - steps).std(axis=0))
    assert (np.abs(ratio / (1 + 1.2 / dof) - 1) < 0.05).all()
    out = sldvexp("aim", str(run_folder), "at=0.2,0.15,0").out
    told = numbers(out, "dac # # ± # #, mirrors")
    assert told == pytest.approx([*np.rint(steps), *bounds], rel=0.06)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nope"], "nope: there is no such file; a run's dataset is called run.nc"),
        ([*GIVEN, "view=lft"], "command line: there is no view lft; did you mean left? Vali"),
        ([*GIVEN, "at=1,2"], "command line: at=1,2: must be a point x,y,z, numbers with commas"),
        ([*GIVEN, "dac=1,b"], "command line: dac=1,b: must be steps up_down,left_right, numbers w"),
        ([*GIVEN, "unit=elle"], "command line: unit: unknown unit 'elle'; Valid: cm, f"),
        ([*GIVEN, "dac=9000,0"], "command line: dac=9000,0: the up_down DAC step 9000 is not with"),
        ([*GIVEN, "point=1,1,1"], "command line: aim takes no point=1,1,1; Valid: at, dac"),
        (["seed=1", "."], "command line: aim takes the folder of a run, ., or settings, not both"),
        (["seed=1", "somewhere"], "command line: somewhere is neither a run nor a "),
        (["~experiment", "target=dissertation"], "aim: these settings say nowhere where the instr"),
        (["experiment=plat"], "command line: there is no experiment=plat; did you mean plate"),
        ([*GIVEN, "~laser"], "aim: there is no laser; choose laser=ometron"),
    ],
)  # fmt: skip
def test_what_cannot_be_told_gets_one_sentence(sldvexp, words, told):
    done = sldvexp("aim", *words)
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith(f"sldvexp: {told}"), done.err
    assert done.err.count("\n") == 1


def test_files_of_a_strange_folder_name_no_code(sldvexp, tmp_path):
    file = tmp_path / "lab/experiment/x.yaml"
    file.parent.mkdir(parents=True)
    file.write_text(
        "# @package _global_\nhydra: {callbacks: {q: {_target_: os.mkdir, path: ran}}}\n"
    )
    done = sldvexp("aim", "--config-dir", str(tmp_path / "lab"), "experiment=x")
    assert done.status == 1
    assert "hydra.callbacks.q._target_ is refused" in done.err
