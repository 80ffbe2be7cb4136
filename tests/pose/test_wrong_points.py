"""Registrations with wrong points: found, named and left out, by a method that knows no noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats

from sldvexp.dataset import verdict_of, views_without_pose
from sldvexp.errors import UserError
from sldvexp.geometry import rotation_from_vector
from sldvexp.io.registration import RegistrationTable, write
from sldvexp.laser import TwoMirror, project
from sldvexp.pose import solve_points
from sldvexp.pose.manual import Manual
from sldvexp.pose.registration import Registration
from sldvexp.targets import FiducialPoint, FiducialPoints
from sldvexp.units import LengthUnit

LASER = TwoMirror(mirror_offset=0.03)
METHOD = Registration(path="not read")
#: Size of the object and its distance, m, noise of a reading in DAC steps.
SIZE, DISTANCE, NOISE = 0.25, 1.7, 0.5


@dataclass
class Session:
    """Many views of an object of `points` points, at random places within `depth` of a plane."""

    seed: int
    views: int
    points: int = 16
    depth: float = 0.0

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed)
        self.object, self.angle, self.origin = [], [], []
        for _ in range(self.views):
            rotation, origin = self._stand()
            half = [SIZE / 2, SIZE / 2, self.depth / 2]
            points = self.rng.uniform(-1, 1, (self.points, 3)) * half
            angle = project((points - origin) @ rotation.T, LASER.mirror_offset)
            self.object.append(points)
            self.angle.append(angle + NOISE * LASER.step * self.rng.standard_normal(angle.shape))
            self.origin.append(origin)

    def _stand(self):
        """Up to 35 deg aside, rolled by up to 10 deg, aimed at the middle."""
        tilt, around, roll = self.rng.uniform([0, 0, -10], [35, 360, 10]) * np.pi / 180
        aside = tilt * np.array([np.cos(around), np.sin(around), 0.0])
        facing = np.diag([1.0, -1.0, -1.0]) @ rotation_from_vector(aside)
        rotation = rotation_from_vector([0.0, 0.0, roll]) @ facing
        return rotation, -DISTANCE * rotation[2]

    def spoil(self, count, steps):
        """Displace the images of some points of each view, in any direction; their positions."""
        wrong = [self.rng.choice(self.points, count, replace=False) for _ in self.angle]
        for angle, own in zip(self.angle, wrong, strict=True):
            way = self.rng.uniform(0, 2 * np.pi, count)
            angle[own] += steps * LASER.step * np.stack([np.cos(way), np.sin(way)], axis=1)
        return wrong

    def exchange(self):
        """Exchange two points of each view; their positions."""
        wrong = [self.rng.choice(self.points, 2, replace=False) for _ in self.angle]
        for angle, own in zip(self.angle, wrong, strict=True):
            angle[own] = angle[own[::-1]]
        return wrong

    def tables(self, scale=(1.0, 1.0, 1.0), unit=LengthUnit.m):
        number = np.arange(1, self.points + 1)
        return [
            RegistrationTable(
                f"{k}", number, points * scale, angle=angle, unit=unit, source="marks.csv"
            )
            for k, (points, angle) in enumerate(zip(self.object, self.angle, strict=True))
        ]

    def solve(self, method=METHOD, target=None, **options):
        return method.solve(self.tables(**options), LASER, target)

    def errors(self, found):
        """Distances of the origins from the true ones, m."""
        return np.linalg.norm(found.origin - self.origin, axis=1)

    def oracle(self, wrong):
        """Distances of the origins that whoever knows the wrong points would find."""
        found = []
        for points, angle, origin, own in zip(
            self.object, self.angle, self.origin, wrong, strict=True
        ):
            right = np.setdiff1d(np.arange(self.points), own)
            one = solve_points(
                points[right], angle[right], step=LASER.step, mirror_offset=LASER.mirror_offset
            )
            found.append(np.linalg.norm(one.origin - origin))
        return np.array(found)


def named(found, views, kind):
    """Numbers of the points that findings of a kind name, by view."""
    names = {f"{k}": set() for k in range(views)}
    for finding in found.findings:
        if finding.kind == kind:
            view, points = finding.subject.removeprefix("view ").split(", ", 1)
            names[view] |= {int(w) for w in points.replace(",", " ").split() if w.isdigit()}
    return list(names.values())


def at_least(rate, trials):
    """Successes that a rate gives at the least, in 999 of 1000 tests like this."""
    return stats.binom.ppf(1e-3, trials, rate)


VIEWS = [8, pytest.param(150, marks=pytest.mark.long)]


@pytest.mark.whole
@pytest.mark.parametrize("views", VIEWS)
def test_clean_registrations_keep_all_their_points(views):
    session = Session(1, views)
    found = session.solve()
    losing = sum(bool(n) for n in named(found, views, "wrong_point"))
    assert views - losing >= at_least(0.98, views)
    assert all(f.kind == "wrong_point" for f in found.findings)


@pytest.mark.whole
@pytest.mark.parametrize("views", VIEWS)
@pytest.mark.parametrize(("count", "steps"), [(1, 5), (1, 200), (2, 5), (2, 20)])
def test_wrong_points_are_named_and_cost_the_pose_nothing(views, count, steps):
    session = Session(100 * count + steps, views)
    wrong = session.spoil(count, steps)
    found = session.solve()
    exactly = [
        n == set(w + 1) for n, w in zip(named(found, views, "wrong_point"), wrong, strict=True)
    ]
    assert sum(exactly) >= at_least(0.95, views)
    assert np.median(session.errors(found)) <= 1.1 * np.median(session.oracle(wrong))


@pytest.mark.parametrize("views", [4, *(pytest.param(8, marks=pytest.mark.whole), VIEWS[1])])
def test_exchanged_points_are_named_together(views):
    session = Session(3, views)
    wrong = session.exchange()
    found = session.solve()
    exactly = [
        n == set(w + 1) for n, w in zip(named(found, views, "exchanged_points"), wrong, strict=True)
    ]
    assert sum(exactly) >= at_least(0.95, views)
    assert np.median(session.errors(found)) <= 1.1 * np.median(session.oracle(wrong))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("views", [1, pytest.param(150, marks=pytest.mark.long)])
@pytest.mark.parametrize("depth", [0.05, 0.15])
def test_mirrored_solids_are_seen(views, depth):
    found = Session(4, views, depth=depth).solve(scale=[1.0, 1.0, -1.0])
    assert [f.kind for f in found.findings] == ["mirrored"] * views
    assert {f.severity.name for f in found.findings} == {"void"}
    assert not any(f.kind == "mirrored" for f in Session(4, views, depth=depth).solve().findings)


def test_a_clean_registration_keeps_its_bits():
    session = Session(5, 2)
    found = session.solve()
    for k, (points, angle) in enumerate(zip(session.object, session.angle, strict=True)):
        alone = solve_points(points, angle, step=LASER.step, mirror_offset=LASER.mirror_offset)
        view = found.pose.isel(view=k)
        np.testing.assert_array_equal(view["origin"], alone.origin)
        np.testing.assert_array_equal(view["covariance"], alone.covariance)
        np.testing.assert_array_equal(view["residual"], alone.residual)
        np.testing.assert_array_equal(view["residual_rms"], alone.residual_rms)
    assert found.registration["used"].values.all()
    assert not found.findings


def test_a_wrong_point_is_shown_and_counts_nowhere():
    session = Session(6, 2)
    session.angle[1][6] += 30 * LASER.step
    found = session.solve()
    (finding,) = found.findings
    assert finding.subject == "view 1, point 7"
    assert "point 7 of marks.csv lies" in finding.text
    assert finding.severity.name == "note"
    assert finding.p_value < 1e-6
    assert finding.size == pytest.approx(30 * np.sqrt(2), abs=4 * NOISE)
    view = found.pose.isel(view=1)
    residual = view["residual"].sel(point=7)
    assert np.linalg.norm(residual) == pytest.approx(finding.size)
    assert view["residual_rms"] < 2 * NOISE
    assert view["dof"] == 2 * 15 - 6
    used = found.registration["used"]
    assert used.sum() == 31
    assert used.sel(view="1", point=7) == 0


def test_too_many_wrong_points_leave_the_pose_in_doubt():
    session = Session(7, 1, points=12)
    session.angle[0][:4] += LASER.step * np.array([[60, 0], [-70, 30], [0, 90], [50, -50]])
    found = session.solve()
    assert named(found, 1, "wrong_point") == [{1, 2, 3, 4}]
    assert {f.severity.name for f in found.findings} == {"doubtful"}


def test_few_points_are_said_to_hide_wrong_ones():
    (finding,) = Session(8, 1, points=5).solve().findings
    assert finding.kind == "untested"
    assert finding.severity.name == "note"


def few(seed, count, spoil):
    """Findings about a few points whose angles are spoilt, by a method that knows their errors."""
    session = Session(seed, 1, points=count, depth=0.05)
    spoil(session.angle[0])
    return [f for f in session.solve(Manual(path="not read")).findings if f.severity.name != "note"]


@pytest.mark.one_in(6)
@pytest.mark.parametrize("method", [METHOD, Manual(path="not read")])
@pytest.mark.parametrize(("count", "sessions"), [(4, 3), (5, 3), (6, 1)])
def test_invented_places_are_void(method, count, sessions):
    """A handful of places that nobody pointed at give a pose, and a run that cannot be believed."""
    rng = np.random.default_rng(count)
    for seed in range(sessions):
        session = Session(seed, 1, points=count, depth=0.05)
        session.angle[0] = rng.uniform(-0.15, 0.15, (count, 2))
        try:
            found = session.solve(method)
        except UserError as error:
            assert "no pose was found" in str(error)  # noqa: PT017
            continue
        assert verdict_of(found.findings) == "void"


def test_a_wrong_one_of_five_points_is_named():
    def aside(angle):
        angle[2] += 30 * LASER.step

    (finding,) = few(8, 5, aside)
    assert (finding.kind, finding.severity.name) == ("wrong_point", "void")
    assert finding.subject == "view 0, point 3"
    assert "point 3 lies " in finding.text
    assert finding.size == pytest.approx(30 * np.sqrt(2), rel=0.3)
    (finding,) = few(8, 4, aside)
    assert finding.subject == "view 0, points 1, 2, 3 and 4"


def test_exchanged_ones_of_five_points_are_named():
    def exchange(angle):
        angle[[1, 3]] = angle[[3, 1]]

    (finding,) = few(9, 5, exchange)
    assert (finding.kind, finding.severity.name) == ("exchanged_points", "void")
    assert finding.subject == "view 0, points 2 and 4"


def test_three_points_fit_several_poses():
    (finding,) = few(10, 3, lambda angle: None)
    assert (finding.kind, finding.severity.name) == ("untested", "doubtful")
    assert "its three points fit 2 poses, at (" in finding.text


def test_three_points_with_each_others_numbers_are_named_together():
    session = Session(9, 1)
    session.angle[0][[2, 5, 9]] = session.angle[0][[5, 9, 2]]
    (finding,) = session.solve().findings
    assert finding.subject == "view 0, points 3, 10 and 6"
    assert finding.remedy == "exchange points 3, 10 and 6 in marks.csv"


def test_a_mirror_that_is_read_the_other_way_round_mirrors_a_solid():
    session = Session(10, 1, depth=0.1)
    session.angle[0][:, 0] *= -1
    (finding,) = session.solve().findings
    assert finding.kind == "mirrored"
    assert "pose.inverted=[up_down]" in finding.remedy


def test_an_instrument_behind_a_planar_object_is_doubted():
    session = Session(11, 1)
    session.angle[0][:, 0] *= -1
    (finding,) = session.solve().findings
    assert (finding.kind, finding.severity.name) == ("mirrored", "doubtful")


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("depth", "scale"), [(0.0, 0.0254), (0.1, 0.0254), (0.0, 1000.0)])
def test_a_wrong_unit_is_seen_by_where_the_instrument_would_stand(depth, scale):
    session = Session(12, 1, points=8, depth=depth)
    (finding,) = session.solve(scale=[scale] * 3).findings
    assert (finding.kind, finding.severity.name) == ("unit", "void")
    assert finding.remedy.endswith("unit of marks.csv")


@pytest.mark.whole
def test_a_wrong_unit_without_a_pose_is_named():
    method = Registration(path="not read", max_iterations=30)
    told = "no pose was found in 30 iterations.* the angles fit object points in m, to"
    with pytest.raises(UserError, match=told):
        Session(12, 1, points=8).solve(method, scale=[0.001] * 3, unit=LengthUnit.mm)


def test_a_wrong_unit_is_seen_by_the_calibration_object():
    session = Session(13, 1)
    fiducials = {n: FiducialPoint(*xyz) for n, xyz in enumerate(session.object[0].tolist(), 1)}
    target = FiducialPoints(unit=LengthUnit.m, accuracy=1e-3, fiducials=fiducials)
    (finding,) = session.solve(target=target, scale=[10.0] * 3).findings
    assert (finding.kind, finding.severity.name) == ("unit", "void")
    assert finding.size == pytest.approx(10.0)
    assert finding.remedy == "divide the object points of marks.csv by 10"
    assert not session.solve(target=target).findings


def test_a_view_without_a_pose_does_not_end_the_others():
    session = Session(14, 3)
    session.object[1] = session.object[1] * [1.0, 0.0, 0.0]
    found = session.solve()
    (finding,) = found.findings
    assert (finding.kind, finding.subject, finding.severity.name) == ("no_pose", "view 1", "void")
    assert "lie on one line" in finding.text
    assert found.views == ["0", "2"]
    assert views_without_pose({"pose": found.pose}) == ["1"]


def test_no_pose_at_all_ends_the_run():
    session = Session(15, 1)
    session.object[0] = session.object[0] * [1.0, 0.0, 0.0]
    with pytest.raises(UserError, match="view 0: the object points lie on one line"):
        session.solve()


@pytest.mark.whole
@pytest.mark.parametrize(
    "options", [{"adjust": {"mirror_offset": 0.01}}, {"shared": {"mirror_offset": 0.01}}]
)
def test_wrong_points_are_left_out_of_adjusted_intrinsics(options):
    session = Session(16, 3, depth=0.1)
    clean = session.solve(Registration(path="not read", **options))
    session.angle[2][4] += 40 * LASER.step
    found = session.solve(Registration(path="not read", **options))
    assert [f.subject for f in found.findings] == ["view 2, point 5"]
    moved = np.abs(found.pose["intrinsic"] - clean.pose["intrinsic"])
    assert (moved < clean.pose["intrinsic_std"]).all()


def test_marks_are_judged_by_what_is_stated_of_them():
    session = Session(17, 2, points=9)
    fiducials = {n: FiducialPoint(*xyz) for n, xyz in enumerate(session.object[0].tolist(), 1)}
    target = FiducialPoints(unit=LengthUnit.m, accuracy=1e-5, fiducials=fiducials)
    session.object[1], session.origin[1] = session.object[0], session.origin[0]
    session.angle[1] = session.angle[0].copy()
    session.angle[1][3] += 60 * LASER.step
    found = session.solve(Manual(path="not read", pointing=0.5), target)
    assert [f.subject for f in found.findings] == ["view 1, point 4"]
    # Errors as small as these are no errors of marks that are pointed at this roughly.
    assert not session.solve(Manual(path="not read", pointing=60.0), target).findings


@pytest.mark.whole
def test_a_run_stops_at_a_doubtful_pose_if_told_to(sldvexp):
    calls = ("experiment=spoiled/mirrored", "experiment=spoiled/wrong_point")
    assert [sldvexp(c, "on_doubt=stop").status for c in calls] == [2, 0]


@pytest.mark.whole
def test_a_view_without_a_pose_is_told_by_the_command(sldvexp, tmp_path):
    session = Session(18, 2)
    short, whole = session.tables()
    path = tmp_path / "two.csv"
    write(path, [whole, short.part(np.arange(16) < 2)])
    done = sldvexp("experiment=pose", f"pose.path={path}", "laser=two_mirror")
    assert done.status == 0, done.err
    assert "view 0 has no pose, and its images are left out" in done.out.replace("\n", "")
    assert done.tree.attrs["verdict"] == "void"
    assert done.tree["pose"]["view"].values.tolist() == ["1"]
