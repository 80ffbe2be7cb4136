"""`sldvexp plan`: what it prints, writes and refuses, through the real command."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from sldvexp.planner.files import as_pose
from sldvexp.planner.images import Stand

QUICK = (
    *("volume.shape=[5,5]", "volume.layers=2", "plan.candidates=100"),
    "scan.structure.pixels=[17,21]",
)


def words(text: str) -> str:
    return " ".join(text.split())


@pytest.fixture
def planned(sldvexp):
    """Plan three stands into the folder lab."""
    done = sldvexp("plan", *QUICK, "plan.stands=3", "--to", "lab", "--name", "monday")
    assert (done.status, done.err) == (0, "")
    return done


def test_a_plan_is_written_as_an_experiment_with_poses_and_a_figure(planned):
    written = ["experiment/monday.yaml", "pose/monday.yaml", "figures/monday.png"]
    assert all(f"lab/{name}" in planned.out and Path("lab", name).is_file() for name in written)
    made = yaml.safe_load(Path("lab/experiment/monday.yaml").read_text())
    views = made["scene"]["views"]
    assert list(views) == ["1", "2", "3"]
    assert all(set(view) == {"origin", "look_at"} for view in views.values())
    scan = made["scan"]
    assert scan["poses"] == views
    assert len(scan["structure"]["corners_at"]) == 8  # of a volume 24 mm deep
    assert yaml.safe_load(Path("lab/pose/monday.yaml").read_text())["views"] == views
    assert "expect" not in made
    said = (
        "stands were looked for from y = -0.9 m, up to y = 1.1 m, 1.2 to 2.5 m away, as "
        "plan.room.low, plan.room.high and plan.room.distance are not set"
    )
    assert said in words(planned.out)
    assert "both mirrors at step 0" in words(planned.out)


@pytest.mark.whole
def test_a_run_takes_a_plan_as_it_is_and_finds_its_stands(planned, sldvexp):
    done = sldvexp("--config-dir", "lab", "experiment=monday", "report=none", "hydra.run.dir=run")
    assert (done.status, done.err) == (0, "")
    from sldvexp import open_run

    tree = open_run("run")
    made = yaml.safe_load(Path("lab/pose/monday.yaml").read_text())["views"]
    assert [str(v) for v in tree["pose"]["view"].values] == list(made)
    off = tree["pose"]["origin"].values - [view["origin"] for view in made.values()]
    assert np.abs(off).max() < 1e-3
    again = sldvexp("plan", "next", "run", "plan.candidates=100")
    assert (again.status, again.err) == (0, "")
    assert "│ 4     │" in again.out
    checked = sldvexp("plan", "check", "run", "plan.room.incidence=40")
    assert "beyond the incidence allowed" in words(checked.out)


@pytest.mark.whole
def test_the_planned_poses_can_be_taken_instead_of_being_found(planned, sldvexp):
    done = sldvexp("--config-dir", "lab", "experiment=monday", "pose=monday", "--cfg", "job")
    assert done.status == 0
    pose = yaml.safe_load(done.out)["pose"]
    assert pose["views"]["1"]["look_at"]


def test_a_zero_is_written_without_a_sign():
    zero = np.array([-0.00001, -0.0, 1.0])
    stand = Stand("1", zero, zero, np.eye(3), np.zeros((4, 2), int), np.zeros((0, 2), int))
    assert str(as_pose(stand)) == "{'origin': [0.0, 0.0, 1.0], 'look_at': [0.0, 0.0, 1.0]}"


#: Rough poses that predict circles and region.
ROUGH = [
    "~experiment",
    "target=dissertation",
    "laser=mine",
    "scan=session",
    "instrument=visa",
    "signal=sine_fit",
    "pose=edge",
    "volume=grid",
    "volume.center=[0.42,0.14,0]",
    "volume.shape=[9,7]",
    "reconstruction=samplewise",
    "plan.candidates=300",
    "scan.structure.stride=90",
    "scan.structure.corners_at=[[0.28,0.02,0],[0.56,0.02,0],[0.56,0.26,0],[0.28,0.26,0]]",
]
STANDS = {
    "front": {"origin": [0.3, 0.1, 1.7], "look_at": [0.3, 0.1, 0]},
    "left": {"origin": [-0.7, 0.2, 1.4], "look_at": [0.3, 0.1, 0]},
    "right": {"origin": [1.2, 0.3, 1.3], "look_at": [0.3, 0.1, 0]},
}
POSES = f"scan.poses={STANDS}".replace("'", "")


@pytest.mark.whole
def test_rough_poses_of_a_folder_of_ones_own_are_checked_and_planned_anew(sldvexp):
    file = Path("lab/laser/mine.yaml")
    file.parent.mkdir(parents=True)
    file.write_text("defaults: [schema/two_mirror@_here_, _self_]\nup_down: {gain: 22}\n")
    own = ("--config-dir", "lab", *ROUGH, POSES)
    checked = sldvexp("plan", "check", *own)
    assert (checked.status, checked.err) == (0, "")
    assert all(f"│ {name} " in checked.out for name in STANDS)
    done = sldvexp("plan", *own, "plan.stands=3", "--to", "lab", "--name", "next")
    assert (done.status, done.err) == (0, "")
    made = yaml.safe_load(Path("lab/experiment/next.yaml").read_text())
    assert list(made["scan"]["poses"]) == ["1", "2", "3"]
    assert "calibration" not in made["scan"]
    told = sldvexp("aim", "--config-dir", "lab", "experiment=next", "view=2")
    assert (told.status, told.err) == (0, "")
    assert told.out.count("circle") == 4
    assert "out of reach" not in told.out


def looks_at(table: str) -> list[str]:
    """Read the places that the stands of a table look at."""
    return [line.split("│")[3].strip() for line in table.splitlines() if line.startswith("│ ")]


@pytest.mark.whole
@pytest.mark.parametrize("unit", ["m", "mm"])
def test_a_plan_without_any_rough_pose_has_them_for_all_that_follows(sldvexp, unit):
    Path("lab/laser").mkdir(parents=True)
    Path("lab/laser/mine.yaml").write_text(
        "defaults: [schema/two_mirror@_here_, _self_]\nup_down: {gain: 22}\n"
    )
    own = ("--config-dir", "lab")
    bare = [word for word in ROUGH if "corners_at" not in word]
    bare += ["plan.stands=3", f"scan.structure.unit={unit}", "volume.size=[0.3,0.2]"]
    bare += ["volume.thickness=0.002"]
    done = sldvexp("plan", *own, *bare, "--to", "lab", "--name", "bare")
    assert (done.status, done.err) == (0, "")
    scan = yaml.safe_load(Path("lab/experiment/bare.yaml").read_text())["scan"]
    assert list(scan["poses"]) == ["1", "2", "3"]
    assert "calibration" not in scan
    assert "views" not in scan["structure"]
    corners = np.array(scan["structure"]["corners_at"]) / {"m": 1, "mm": 1000}[unit]
    assert np.ptp(corners, axis=0)[:2] == pytest.approx([0.309, 0.206], abs=2e-4)
    checked = sldvexp("plan", *own, "check", "experiment=bare")
    assert (checked.status, checked.err) == (0, "")
    assert "does not" not in checked.out
    assert "beyond" not in checked.out
    assert looks_at(checked.out)[:3] == looks_at(done.out)[:3]
    told = sldvexp("aim", *own, "experiment=bare", "view=2")
    assert (told.status, told.err) == (0, "")
    assert [told.out.count(word) for word in ("circle", "corners_at, point", "corner ")] == [
        4,
        8,
        4,
    ]


@pytest.mark.whole
def test_poses_that_are_given_but_not_yet_known_are_what_a_plan_writes(sldvexp):
    done = sldvexp("plan", *QUICK, "pose=given", "plan.stands=3", "--to", "lab")
    assert (done.status, done.err) == (0, "")
    made = yaml.safe_load(Path("lab/experiment/planned.yaml").read_text())
    assert made["pose"]["views"] == made["scene"]["views"]
    again = sldvexp("plan", "check", "--config-dir", "lab", "experiment=planned")
    assert (again.status, again.err) == (0, "")


def test_who_has_no_stands_is_told_the_setting_that_takes_them(sldvexp):
    bare = [word for word in ROUGH if not word.startswith("laser")]
    checked = sldvexp("plan", "check", *bare, "laser=ometron")
    assert "scan=session and scan.poses" in checked.err
    assert "give rough poses in scan.poses, or" in sldvexp("aim", *bare, "laser=ometron").err


@pytest.mark.whole
def test_a_plan_replaces_files_only_if_asked(planned, sldvexp):
    before = Path("lab/experiment/monday.yaml").read_bytes()
    again = ("plan", *QUICK, "plan.stands=4", "--to", "lab", "--name", "monday")
    done = sldvexp(*again)
    assert done.status == 1
    assert done.err.endswith("exists; overwrite=true puts this plan in its place\n")
    assert done.out == ""  # refused before anything is looked for
    assert Path("lab/experiment/monday.yaml").read_bytes() == before
    assert sldvexp(*again, "overwrite=true").status == 0
    assert Path("lab/experiment/monday.yaml").read_bytes() != before
    made = yaml.safe_load(Path("lab/experiment/monday.yaml").read_text())
    assert list(made["scene"]["views"]) == ["1", "2", "3", "4"]
    assert "overwrite" not in made


@pytest.mark.whole
def test_a_plan_is_written_whole_or_not_at_all(sldvexp):
    Path("lab/pose/monday.yaml").mkdir(parents=True)
    done = sldvexp("plan", *QUICK, "--to", "lab", "--name", "monday", "overwrite=true")
    assert done.status == 1
    assert not Path("lab/experiment/monday.yaml").exists()


@pytest.mark.one_in(2)
@pytest.mark.parametrize("folder", ["taken/lab", "/proc/nope"])
def test_a_folder_that_takes_no_files_is_told_before_a_plan_is_looked_for(
    folder, sldvexp, monkeypatch
):
    def planned(*_):
        raise AssertionError("it was computed")

    monkeypatch.setattr("sldvexp.planner.plan", planned)
    Path("taken").write_text("a file")
    done = sldvexp("plan", *QUICK, "--to", folder)
    assert done.status == 1
    assert f"{folder}/experiment/planned.yaml: cannot be written: " in done.err


@pytest.mark.whole
def test_the_next_stand_is_written_beside_those_that_are_there(sldvexp):
    done = sldvexp("plan", "next", *QUICK, "--to", "lab")
    assert (done.status, done.err) == (0, "")
    made = yaml.safe_load(Path("lab/experiment/planned.yaml").read_text())
    assert list(made["scan"]["structure"]["views"]) == ["1", "2", "3", "4", "5"]
    assert list(made["scan"]["poses"]) == ["6"]


def test_a_check_names_nodes_and_reasons(sldvexp):
    pillar = "{pillar: {low: [0.35, 0.0, 0.6], high: [0.4, 0.3, 0.7]}}"
    done = sldvexp("plan", "check", *QUICK, f"plan.room.forbidden={pillar}")
    assert done.status == 0
    assert "does not see" in done.out
    assert "behind a forbidden box" in words(done.out)


def test_a_check_names_circles_that_are_too_oblique_with_their_planes_and_angles(sldvexp):
    done = sldvexp("plan", "check", *QUICK, "plan.room.incidence=20")
    assert done.status == 0
    told = (
        r"calibration object too oblique, circle (\d) on the plane front at (\d\d\.\d) deg( and "
        r"circle \d on the plane front at \d\d\.\d deg)* \(plan\.room\.incidence=20"
    )
    assert (found := re.search(told, words(done.out)))
    assert 20 < float(found[2]) < 60


REFUSED = [
    ("experiment=pose", "plan: there is no volume, so that nobody knows what is to be seen; "),
    ("plan.stands=2", "plan.stands must be from 3 to 8, not 2: fewer views do not determine"),
    ("plan.stands=9", "plan.stands must be from 3 to 8, not 9"),
    ("plan.of=q", "plan.of must be one of all, in_plane, x, y, z, t1, t2, n, or a direction"),
    ("plan.of=[0,0,0]", "plan.of must be one of"),
    ("plan.wanted=0", "plan.wanted must be a positive number, not 0"),
    ("plan.room.distance=[2,1]", "plan.room.distance must be a nearest and a larger farthest"),
    ("plan.room.incidence=95", "plan.room.incidence must lie between 0 and 90 deg, not 95"),
    (
        "plan.room.incidence=1.05",
        "plan.room.incidence is in deg, and 1.05 deg leaves no stand: 60.2 if rad are meant",
    ),
    ("plan.room.mirrors=2", "plan.room.mirrors must be above 0 and at most 1, not 2"),
    ("plan.room.low=[0,0]", "plan.room.low must be three numbers or null, not 2"),
    ("plan.rooms=1", "plan.rooms is not a known setting; did you mean room?"),
    (
        "plan.room.forbidden={a:{low:[0,0,-1],high:[1,1,1]}}",
        "plan.room.forbidden.a: holds ",
    ),
    (
        "plan.room.forbidden={a:{low:[0,0,0],high:[1,0,1]}}",
        "plan.room.forbidden.a.high must be above low",
    ),
    ("plan.room.incidence=2", "plan: no stand is feasible: plan.room.incidence"),
    ("nowhere", "command line: there is no plan nowhere; "),
    ("chek", "command line: there is no plan chek; did you mean check?"),
    ("plan.room.low=[-1000,-800,0]", "command line: plan.room.low is -1000 m, which no scanning"),
    ("plan.room.distance=[1200,2500]", "command line: plan.room.distance is 2500 m, which no sca"),
    ("check nowhere", "nowhere: "),
    ("--name x", "command line: --name is of the files that --to=folder writes"),
    (
        "~scene next instrument=file instrument.path=a.csv",
        "plan: there are no stands to go on from",
    ),
]


@pytest.mark.one_in(6)
@pytest.mark.parametrize(("arguments", "answer"), REFUSED)
def test_bad_inputs_are_told_in_one_sentence(arguments, answer, sldvexp):
    done = sldvexp("plan", *arguments.split(), "plan.candidates=50")
    assert done.status == 1
    assert done.err.startswith("sldvexp: ")
    assert answer in done.err
    assert done.err.count("\n") == 1
    assert not list(Path().iterdir())
