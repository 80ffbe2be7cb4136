"""Circles and marks that cannot be aimed at from where the instrument stands are not asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.console.bench import AimingBench
from sldvexp.console.marks import CIRCLE, wanted
from sldvexp.console.outlook import Outlook
from sldvexp.errors import UserError
from sldvexp.scan.session import Session
from sldvexp.targets import Circle, Plane
from sldvexp.virtual_lab.lab import VirtualLab
from tests.console.test_bench import Seen

#: The fifth circle, inches: on a plane above the instrument that faces up, or far to the side.
AWAY, FAR = Circle(3, 0, 0.8, "top"), Circle(200, 5, 0.8)


@pytest.fixture(params=["away", "far"])
def boxed(request, lab_experiment):
    """The plate with a calibration object of five circles, of which one cannot be aimed at."""
    e = lab_experiment
    planes = e.target.planes | {"top": Plane([0, 35, 0], [0, 1, 0])}
    fifth = AWAY if request.param == "away" else FAR
    target = replace(e.target, planes=planes, circles=e.target.circles | {5: fifth})
    calibration = replace(e.scan.calibration, views={})
    structure = replace(e.scan.structure, views={})
    scan = Session(calibration, structure, poses={"1": e.scene.views["1"]})
    return replace(e, target=target, scan=scan), request.param


TOLD = {
    "away": "not seen from here: its plane top is turned away",
    "far": " deg) beyond the left-right mirror's reach",
}


@pytest.mark.parametrize("marks", [0, 3])
def test_the_page_tells_what_cannot_be_aimed_at_and_does_not_ask_for_it(boxed, marks):
    made, why = boxed
    lab = VirtualLab(made.scene, made.laser, None, 0)
    lab.use_view("1")
    known = {n: c for n, c in made.target.circles.items() if n != 5}
    centres = replace(made.target, circles=known).outlines().mean(axis=1)
    steps = np.rint(lab.true_dac(centres)).astype(int).tolist()
    if marks:
        made = replace(made, scan=replace(made.scan, poses={}))
    taken = {(CIRCLE, n): tuple(steps[n - 1]) for n in (1, 2, 3)[:marks]}
    found = Outlook(made, wanted(made)).of(taken, "1")
    assert list(found.out) == [(CIRCLE, 5)]
    assert found.out[CIRCLE, 5].endswith(TOLD[why])
    assert f"Circle 5 is {found.out[CIRCLE, 5]}. The scan needs every circle: " in found.told
    assert "scan at once" not in found.told
    assert (CIRCLE, 5) not in found.predicted
    assert (CIRCLE, 4) in found.predicted
    if why == "far":
        (out,) = [int(word) for word in found.out[CIRCLE, 5].split() if word.isdecimal()]
        # 4.8 m aside at 1.7 m are 71 deg, of which 25 are reached, of 164 steps each.
        assert 7000 < out < 8000


def test_the_list_of_marks_has_it_for_browsers(boxed, board, wishes):
    made, why = boxed
    bench = AimingBench(made, board, wishes)
    (out,) = Seen(board).look()["marks"]["out"]
    assert (out["kind"], out["number"]) == (CIRCLE, 5)
    assert out["why"].endswith(TOLD[why])
    bench.leave()


def test_a_scan_of_a_circle_that_is_turned_away_is_refused_before_anything_moves(boxed):
    made, why = boxed
    told = {
        "away": "circle 5 is not seen, since its plane top is turned away; the scan needs all",
        "far": "circle 5 is out of reach",
    }
    with pytest.raises(UserError, match=f"^scan: in the view 1, {told[why]}"):
        made.scan.in_steps(made.laser, made.target)


def test_aim_tells_what_is_not_seen(sldvexp):
    box = "target.planes={top: {origin: [0, 35, 0], normal: [0, 1, 0]}}"
    fifth = "target.circles={5: {x: 3, y: 0, diameter: 0.8, plane: top}}"
    done = sldvexp("aim", "experiment=plate", box, fifth, "view=1")
    assert done.status == 0, done.err
    assert "\n    it is not seen from here: its plane top is turned away\n" in done.out
    assert done.out.count("not seen from here") == 1
