"""Which spot of a look is which circle, where a rough pose is as wrong as people say one."""

from __future__ import annotations

import queue
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.console.bench import AimingBench
from sldvexp.console.board import NoticeBoard
from sldvexp.console.marks import wanted
from sldvexp.console.outlook import Outlook
from sldvexp.console.spots import LookedAt, LookSpot, SpotsSeen, spots_of
from sldvexp.geometry import KnownPose, euler_from_rotation, rotation_from_vector
from sldvexp.virtual_lab.lab import VirtualLab
from tests.console.two_faces import area_of, box_experiment


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    return box_experiment(tmp_path_factory.mktemp("box"))


@pytest.fixture(scope="module")
def lab(box):
    return VirtualLab(box.scene, box.laser, box.target, box.seed)


class LookingBench:
    """A bench that is steered, and looks."""

    def __init__(self, experiment):
        self.bench = AimingBench(experiment, NoticeBoard(), queue.Queue())
        self.do("taken")

    def do(self, what, **more):
        self.bench.wishes.put({"do": what, **more})
        self.bench.turn()

    def look(self, low, high):
        self.do("look", low=[int(x) for x in low], high=[int(x) for x in high])
        while self.bench._look is not None:
            self.bench.turn()

    def off(self, true):
        """Say how far the predictions of circles lie beside the truth, steps."""
        found = self.bench.foresight(self.bench.view).predicted
        return [np.hypot(*(found["circle", k] - place)) for k, place in enumerate(true, 1)]


@pytest.fixture
def looking(box):
    made = LookingBench(box)
    yield made
    made.bench.leave()


@pytest.mark.whole
@pytest.mark.parametrize("view", ["3", "4"])
def test_a_look_at_all_says_which_spot_is_which_circle_and_marks_go_before_spots(
    looking, lab, view
):
    """The prediction of circle 1 lies midway between two spots, of which one is circle 4."""
    lab.use_view(view)
    true = lab.true_dac(lab.calibration_object.center)
    looking.do("view", name=view)
    assert max(looking.off(true)) > 900  # as far as it is to the edge of a circle, and more
    looking.look((-32768, -32768), (32767, 32767))
    assert max(looking.off(true)) < 150
    told = looking.bench.foresight(view).told
    assert told.startswith("By the scan's rough pose, corrected by 8 spots of the look, ")
    looking.do("move", to=np.rint(true[0]).astype(int).tolist())
    looking.do("mark", kind="circle", number=1)
    told = looking.bench.foresight(view).told
    assert "corrected by 1 mark and 7 spots of the look" in told
    assert max(looking.off(true)[1:]) < 150


@pytest.mark.whole
@pytest.mark.parametrize(("view", "asks"), [("3", False), ("4", True)])
def test_a_near_look_takes_the_right_spot_or_asks_which(looking, lab, view, asks):
    lab.use_view(view)
    true = lab.true_dac(lab.calibration_object.center)
    looking.do("view", name=view)
    at = np.array(looking.bench.foresight(view).predicted["circle", 1])
    looking.look(at - 4096, at + 4096)  # as Go there shows it
    found = looking.bench.foresight(view)
    if asks:
        assert "A spot of the look may be circle 1 or " in found.told
        assert "which? Look at a wider part" in found.told
        ways = np.array(found.instead["circle", 1])
        assert np.hypot(*(ways - true[0]).T).min() < 100  # one of them is it
        looking.look(at - 8192, at + 8192)
    assert looking.off(true)[0] < 100
    assert "which?" not in looking.bench.foresight(view).told


def test_a_mark_tells_which_circle_a_near_look_shows(looking, lab):
    """Without it this look asks; all predictions are known better, and not only moved."""
    lab.use_view("4")
    true = lab.true_dac(lab.calibration_object.center)
    looking.do("view", name="4")
    looking.do("move", to=np.rint(true[1]).astype(int).tolist())
    looking.do("mark", kind="circle", number=2)
    at = np.array(looking.bench.foresight("4").predicted["circle", 1])
    looking.look(at - 4096, at + 4096)
    assert "by 1 mark and 1 spot of the look" in looking.bench.foresight("4").told
    assert looking.off(true)[0] < 20


@pytest.mark.parametrize("edge", [(0, 40), (80, 40), (40, 0), (40, 80)])
def test_what_reaches_an_edge_of_a_look_is_no_spot(edge):
    """Its middle is not known."""
    dac = np.stack(np.meshgrid(range(0, 90, 10), range(0, 90, 10)), axis=-1).reshape(-1, 2)
    value = np.exp(-((dac - edge) ** 2).sum(axis=1) / 100)
    inside = np.exp(-((dac - [40, 40]) ** 2).sum(axis=1) / 100)
    assert len(list(spots_of(dac, inside, inside < 0, 10))) == 1
    assert list(spots_of(dac, value, value < 0, 10)) == []


def beside(pose, rng):
    """A pose some 22 mm and a degree beside another one, anyhow."""
    turn, shift = rng.standard_normal(3), rng.standard_normal(3)
    rotation = rotation_from_vector(np.radians(1) * turn / np.linalg.norm(turn)) @ pose.rotation
    place = pose.place + 0.022 * shift / np.linalg.norm(shift)
    return KnownPose(euler_from_rotation(rotation).tolist(), place.tolist())


def seen_by(true, area, low, high, rng):
    """Spots of a look at a region, with the errors of such a look; those at its edge are none."""
    cell, half = (high - low).max() / 128, np.sqrt(area / np.pi)[:, None]
    inside = np.all((true - half > low) & (true + half < high), axis=1)
    spots = [
        LookSpot(
            place + 0.3 * cell * rng.standard_normal(2), size * rng.uniform(0.7, 1.4), 0.4 * cell
        )
        for place, size in zip(true[inside], area[inside], strict=True)
    ]
    return SpotsSeen([LookedAt(low, high, spots)])


@pytest.mark.whole
@pytest.mark.parametrize("times", [1, pytest.param(25, marks=pytest.mark.whole)])
def test_hardly_a_circle_is_taken_for_another_whatever_the_rough_pose(box, lab, times):
    """Of near looks, which have one spot to three, some ask; wider ones hardly do."""
    rng, wrong, asked, count = np.random.default_rng(5), 0, [], 0
    for view in box.scene.views:
        lab.use_view(view)
        true, pose = lab.true_dac(lab.calibration_object.center), box.scene.views[view]
        for _ in range(times):
            scan = replace(box.scan, poses={view: beside(pose, rng)})
            outlook = Outlook(replace(box, scan=scan), wanted(box))
            alone = outlook.of({}, view)
            area = np.array([area_of(outline) for outline in alone.outlines[:8]])
            at = np.array(alone.predicted["circle", int(rng.integers(1, 9))], float)
            every = (np.full(2, -32768.0), np.full(2, 32767.0))
            for low, high in (every, (at - 8192, at + 8192), (at - 4096, at + 4096)):
                seen = seen_by(true, area, low, high, rng)
                found = outlook.of({}, view, seen)
                count += 1
                wrong += taken_for_another(found, seen, true)
                asked.append("which?" in found.told)
                if low is every[0]:
                    assert "8 spots of the look" in found.told
    assert wrong <= 0.015 * count
    whole, wide, near = np.reshape(asked, (-1, 3)).sum(axis=0)
    sometimes = [part * len(asked) / 3 for part in (0.1, 0.45)]  # and three standard errors
    most = [mean + 3 * np.sqrt(mean) for mean in sometimes]
    assert whole == 0
    assert wide <= most[0]
    assert near <= most[1]


def taken_for_another(found, seen, true):
    """Tell whether a circle is predicted on a spot that is another one."""
    spots = np.array([spot.dac for spot in seen.spots]).reshape(-1, 2)
    if "of the look, " not in found.told or not len(spots):
        return False
    for k in range(8):
        off = np.hypot(*(spots - found.predicted["circle", k + 1]).T)
        circle = int(np.argmin(np.hypot(*(true - spots[np.argmin(off)]).T)))
        if off.min() < 200 and circle != k:
            return True
    return False
