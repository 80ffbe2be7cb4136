"""Every experiment in `conf/experiment/` meets everything that it expects."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

FOLDER = Path(__file__).parents[2] / "conf" / "experiment"
EXPERIMENTS = sorted(str(p.relative_to(FOLDER).with_suffix("")) for p in FOLDER.rglob("*.yaml"))
#: Take more than 4 s.
SLOW = {
    "coupled_panel",
    "curved_panel",
    "dissertation/plate_1",
    "dissertation/plate_2",
    "dissertation/pose_methods",
    "dissertation/repeatability",
    "dissertation/table_5_7_1",
    "dissertation/table_5_7_2",
    "gages",
    "panel_strain",
    "plate",
    "plate_faces",
    "plate_frf",
    "plate_hole",
    "plate_model",
    "plate_modes",
    "plate_strain",
    "spoiled/bent_mirrors",
    "spoiled/conjugate",
    "spoiled/delay",
    "spoiled/drift",
    "spoiled/drop_outs",
    "spoiled/exchanged",
    "spoiled/gain",
    "spoiled/hole",
    "spoiled/jitter",
    "spoiled/moved",
    "spoiled/other_field",
    "spoiled/other_frequency",
    "spoiled/pose",
    "spoiled/rms",
    "spoiled/turned",
    "spoiled/wrong_circle",
    "spoiled/wrong_mirror_gain",
    "tube_strain",
}
#: Take more than a third of a second.
WHOLE = {
    "dissertation/automated_pose",
    "dissertation/measured",
    "dissertation/mirror_offset",
    "dissertation/point_conventions",
    "dissertation/point_measured",
    "dissertation/point_simulated",
    "dissertation/registration",
    "dissertation/velocity_image",
    "part_pose",
    "plate_broadband",
    "plate_model",
    "spoiled/base",
    "spoiled/circles",
    "spoiled/clean",
    "spoiled/exchanged_points",
    "spoiled/hysteresis",
    "spoiled/mirrored",
    "spoiled/phase",
    "spoiled/pointing",
    "spoiled/poor_distance",
    "spoiled/sign",
    "spoiled/wrong_point",
    "spoiled/wrong_size",
    "spoiled/wrong_unit",
    "tutorial",
    "unknown_points",
}
BOUNDS = ("at_least", "at_most")
#: Has its other side by itself: no more than all.
SHARE = re.compile(r"examined/\w+/(peak_)?covered")
MARKS = dict.fromkeys(SLOW, pytest.mark.long) | dict.fromkeys(WHOLE, pytest.mark.whole)
MARKED = [pytest.param(n, marks=MARKS.get(n, ())) for n in EXPERIMENTS]


@pytest.mark.parametrize("name", MARKED)
def test_experiment_meets_its_expectations(name, sldvexp):
    done = sldvexp(f"experiment={name}")
    assert done.status == 0, done.err + done.out
    check = done.tree["check"]
    missed = [
        str(q)
        for q, ok in zip(check["quantity"].values, check["passed"].values, strict=True)
        if not ok
    ]
    assert missed == []
    assert len(check["quantity"]) > 0


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_experiment_expects_something(name):
    text = yaml.safe_load((FOLDER / f"{name}.yaml").read_text())
    included = [d for d in text.get("defaults", []) if isinstance(d, str) and d != "_self_"]
    expect = text.get("expect") or {}
    assert expect or included
    most = {k: v for e in expect.values() for k, v in e.get("at_most", {}).items()}
    assert not [k for k, v in most.items() if SHARE.match(k) and v >= 1], "cannot be missed"


#: Files to begin with, on data of one's own, expect what such data has; truths have a side.
OPEN = {"curved_panel", "digitizer", "plate", "point", "pose"}


#: What a mistake does at least is told from one side.
HARM = {n for n in EXPERIMENTS if n.startswith("spoiled/")}


@pytest.mark.parametrize("name", sorted(set(EXPERIMENTS) - OPEN - HARM))
def test_expectations_have_two_sides(name):
    expect = yaml.safe_load((FOLDER / f"{name}.yaml").read_text()).get("expect") or {}
    least, most = ({k for e in expect.values() for k in e.get(b, {})} for b in BOUNDS)
    assert {k for k in least ^ most if not SHARE.match(k)} == set()


@pytest.mark.long
def test_every_method_on_the_default_session(sldvexp):
    done = sldvexp("check", "methods")
    assert done.status == 0, done.out + done.err
    assert "8 of 8 as expected" in done.out
