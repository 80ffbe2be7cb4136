"""After a view its pose is told, and advice if there is any, while the next one is scanned."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.console.afterwards import Advice, Afterwards, of_view, place_told, sentences
from sldvexp.dataset import Finding
from sldvexp.dataset.findings import (
    findings_of,
    findings_to_dataset,
    take_findings,
    with_findings,
)
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.report import with_bound
from sldvexp.session.session import scan_views
from tests.console.conftest import PATIENCE


@pytest.fixture(scope="module")
def scanned(lab_experiment, tmp_path_factory):
    """Circles of two views, and the experiment that has nothing else."""
    calibration = lab_experiment.scan.calibration
    coarse = replace(calibration.coarse, lines=3, pixels=150)
    fine = replace(calibration.fine, lines=8)
    views = {name: calibration.views[name] for name in ("1", "2")}
    views["2"] = replace(views["2"], circles=[1, 2, 3, 4])
    scan = replace(calibration, views=views, coarse=coarse, fine=fine)
    made = replace(lab_experiment, scan=scan)
    return made, scan_views(made, tmp_path_factory.mktemp("journal"))


def test_pose_of_every_view_is_told_with_bounds_and_verdict(scanned):
    made, groups = scanned
    told, advised = [], []

    def advise(experiment, so_far):
        assert experiment is made
        return Advice([", ".join(sorted(so_far))])

    after = Afterwards(made, lambda views: told.append(dict(views)), advise, advised.append)
    after.view_done("1", {"edge/1": groups["edge/1"]})
    after.view_done("2", {"edge/2": groups["edge/2"]})
    after.end()
    after.join()
    last = told[-1]
    assert list(last) == ["1", "2"]
    for view in last.values():
        assert view[0].startswith("Pose: origin x ")
        assert " mm (95 % bounds); trusted" in view[0]
    assert last["1"][-1].startswith("the circle around DAC steps")
    circles = [line.partition(":")[0] for line in last["2"] if line.startswith("circle")]
    assert circles == ["circle 1", "circle 2", "circle 3", "circle 4"]
    assert advised[-1].told == ["edge/1, edge/2, pose"]
    result = made.pose.estimate(made.laser, made.target, groups)
    pose = result.pose.sel(view="2")
    pairs = zip(1e3 * pose["origin"].values, 1e3 * pose["origin_confidence"].values, strict=True)
    for value, bound in pairs:  # as the report has them
        assert with_bound(value, bound) in last["2"][0]


@pytest.mark.whole
def test_pose_that_further_views_have_made_surer_says_why(scanned):
    """Of an object without errors of its own each view tells of itself alone."""
    made, groups = scanned
    for accuracy in (0.0, 0.05):
        own, told = replace(made, target=replace(made.target, accuracy=accuracy)), []
        after = Afterwards(own, lambda views, told=told: told.append(dict(views)))
        for name in ("1", "2"):
            after.view_done(name, {f"edge/{name}": groups[f"edge/{name}"]})
        after.end()
        after.join()
        first = {"edge/1": groups["edge/1"]}
        alone = place_told(own.pose.estimate(own.laser, own.target, first), "1")
        surer = (
            "Pose: 2 views are estimated together, since the errors of the calibration object are "
            f"the same in all: each tells more of them; when this view was the last, {alone}"
        )
        assert (surer in told[-1]["1"]) == (accuracy > 0)
        assert "together" not in " ".join(told[-1]["2"])


def test_pose_does_not_wait_for_the_advice_after_the_view_before(scanned):
    made, groups = scanned
    told, second, in_time = [], threading.Event(), []

    def advise(*_):
        in_time.append(second.wait(PATIENCE))
        return Advice([])

    def tell(views):
        told.append({name: list(lines) for name, lines in views.items()})
        if "2" in views and views["2"][0].startswith("Pose"):
            second.set()

    after = Afterwards(made, tell, advise)
    for name in ("1", "2"):
        after.view_done(name, {f"edge/{name}": groups[f"edge/{name}"]})
    after.end()
    after.join()
    assert in_time
    assert all(in_time)


@pytest.mark.whole
def test_advice_is_on_all_views_that_have_come_by_then(scanned):
    """What comes while one is computed is advised on once."""
    made, groups = scanned
    advised, all_posed = [], threading.Event()

    def advise(_, so_far):
        all_posed.wait(PATIENCE)
        advised.append(sorted(so_far))
        return Advice([])

    after = Afterwards(made, lambda views: None, advise)
    after.view_done("1", {"edge/1": groups["edge/1"]})
    after.view_done("2", {"edge/2": groups["edge/2"]})
    after.view_done("1", {"image/1": xr.Dataset()})
    after.end()
    for thread in threading.enumerate():
        if thread.name == "afterwards":  # which has told of all poses
            thread.join(PATIENCE)
    all_posed.set()
    after.join()
    assert advised[-1] == ["edge/1", "edge/2", "image/1", "pose"]


def test_pose_that_cannot_be_found_is_told_and_the_next_one_is(scanned, monkeypatch):
    made, groups = scanned
    told = []

    def refused(self, *_):
        raise UserError("three circles are needed")

    monkeypatch.setattr(type(made.pose), "estimate", refused)
    after = Afterwards(made, lambda views: told.append(dict(views)))
    after.view_done("1", {"edge/1": groups["edge/1"]})
    after.end()
    after.join()
    assert told[-1]["1"][-1] == "Pose: not known yet, three circles are needed"


def test_fault_of_what_advises_ends_nothing(scanned):
    made, groups = scanned
    told, advised, failed = [], [], threading.Event()

    def broken_at_first(*_):
        if not failed.is_set():
            failed.set()
            raise ZeroDivisionError
        return Advice(["enough"])

    after = Afterwards(
        made, lambda views: told.append(dict(views)), broken_at_first, advised.append
    )
    after.view_done("1", {"edge/1": groups["edge/1"]})
    assert failed.wait(PATIENCE)
    after.view_done("2", {"edge/2": groups["edge/2"]})
    after.end()
    after.join()
    assert "Pose: origin" in told[-1]["2"][0]
    assert [advice.told for advice in advised] == [["enough"]]


def test_doubt_is_told_of_its_view_alone(scanned):
    made, groups = scanned
    result = made.pose.estimate(made.laser, made.target, groups)
    doubt = Finding("odd", "view 2", "its circles lie elsewhere", views=("2",))
    found = replace(result, findings=[doubt])
    assert "trusted" in sentences(found, "1")[0]
    first, second = sentences(found, "2")
    assert "doubtful" in first
    assert second == "Pose doubtful: its circles lie elsewhere"
    assert of_view(replace(doubt, views=()), "1")
    assert np.isfinite(result.origin).all()


@pytest.mark.parametrize(
    ("subject", "views", "told"),
    [
        ("views 1 and 2", ("1", "2"), ["1", "2"]),
        ("distance of view 1 and point 4", (), ["1", "2", "and point 4"]),
        ("pixels of view left, and point 4", ("left, and point 4",), []),
        ("point 3 of view and point 4", ("and point 4",), ["and point 4"]),
    ],
)
def test_a_finding_is_told_of_the_views_that_it_carries_whatever_its_words(subject, views, told):
    finding = Finding("odd", subject, "odd", views=views)
    assert [view for view in ("1", "2", "and point 4") if of_view(finding, view)] == told


def test_views_of_a_finding_are_kept_with_the_run():
    found = [
        Finding("odd", "views a, b", "odd", views=("a, b", "c")),
        Finding("odd", "run", "even"),
    ]
    kept = findings_of({"verdict": findings_to_dataset(found)})
    assert {f.text: f.views for f in kept} == {"odd": ("a, b", "c"), "even": ()}
    groups = {"image/a": with_findings(xr.Dataset(), found)}
    assert [f.views for f in take_findings(groups)] == [("a, b", "c"), ()]
