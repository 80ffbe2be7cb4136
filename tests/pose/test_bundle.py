"""Unknown points seen from several views: poses without a start, bounds, and wrong sightings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import rotation_towards, vector_from_rotation
from sldvexp.io.registration import RegistrationTable, to_dataset, write
from sldvexp.laser import TwoMirror, project
from sldvexp.pose.base import cross_covariance
from sldvexp.pose.bundle import Bundle, Distance, MeasuredRange
from sldvexp.pose.free_points import Configuration, Sightings

LASER = TwoMirror(mirror_offset=0.03)
FRAME = [1, 2, 3]
#: Standard deviation of the tape's length, m.
TAPE = 1e-4


class Lab:
    """Six points and four views that a seed draws, in the axes of the first three points."""

    def __init__(self, seed, views=4, points=6, flat=False):
        rng = np.random.default_rng(seed)
        places = rng.uniform(-0.25, 0.25, (points, 3)) * [1, 1, 0.0 if flat else 0.5]
        places[:3, :2] = [[-0.2, -0.2], [0.2, -0.15], [-0.1, 0.2]]  # no bad axes by bad luck
        stands = np.array([[0.2, 0.1, 1.6], [-1.0, 0.2, 1.2], [0.9, 0.5, 1.3], [0.1, -1.0, 1.3]])
        origin = stands[:views] + rng.normal(0, 0.1, (views, 3))
        rotation = np.stack([rotation_towards(o, rng.normal(0, 0.03, 3)) for o in origin])
        x = places[1] - places[0]
        x /= np.linalg.norm(x)
        z = np.cross(x, places[2] - places[0])
        z /= np.linalg.norm(z)
        turn = np.stack([x, np.cross(z, x), z])
        self.points = (places - places[0]) @ turn.T
        self.origin = (origin - places[0]) @ turn.T
        self.rotation = rotation @ turn.T
        self.names = ["front", "left", "right", "below"][:views]
        self.length = float(np.linalg.norm(self.points[0] - self.points[1]))

    def steps(self, view):
        """Exact DAC steps of all points."""
        seen = (self.points - self.origin[view]) @ self.rotation[view].T
        return LASER.dac_from_angle(project(seen, LASER.mirror_offset))

    def tables(self, rng=None, hidden=()):
        """Registration data; exact without a generator. `hidden` are (view, point)."""
        made = []
        for k, name in enumerate(self.names):
            steps = self.steps(k)
            if rng is not None:
                steps = steps + rng.standard_normal(steps.shape)
            kept = np.array([(name, n) not in hidden for n in range(1, len(steps) + 1)])
            number = np.arange(1, len(steps) + 1)[kept]
            made.append(
                RegistrationTable(name, number, np.zeros((len(number), 3)), dac=steps[kept])
            )
        return made

    def method(self, rng=None, **settings):
        length = self.length + (0.0 if rng is None else TAPE * rng.standard_normal())
        distances = [Distance([1, 2], length, TAPE)]
        return Bundle(**{"distances": distances, "frame": FRAME, **settings})

    def errors(self, found):
        """Rotation vector and origin, estimated minus true, of all views in a row."""
        turned = vector_from_rotation(found.rotation @ self.rotation.swapaxes(-1, -2))
        return np.concatenate([turned, found.origin - self.origin], axis=1).ravel()


def solve(lab, tables, method):
    return method.estimate(LASER, None, {"registration": to_dataset(tables)})


@pytest.mark.parametrize("views", [2, 4])
def test_noiseless_angles_give_poses_and_points(views):
    lab = Lab(3, views=views, points=8)
    found = solve(lab, lab.tables(), lab.method())
    np.testing.assert_allclose(lab.errors(found), 0, atol=1e-8)
    places = found.registration["object_point"].isel(view=0)
    np.testing.assert_allclose(places, lab.points, atol=1e-8)
    np.testing.assert_allclose(found.registration["object_point_std"][0, 0], 0, atol=1e-12)
    assert not found.findings


#: Standard deviation of a range, m.
RANGED = 1e-3


def ranged(lab, rng=None, pairs=(("front", 1), ("left", 4)), std=RANGED):
    """Ranges from views to points, exact without a generator."""
    found = []
    for view, point in pairs:
        length = np.linalg.norm(lab.points[point - 1] - lab.origin[lab.names.index(view)])
        off = 0.0 if rng is None else std * rng.standard_normal()
        found.append(MeasuredRange(view, point, float(length + off), std))
    return found


def test_ranges_alone_set_the_scale():
    lab = Lab(3)
    method = lab.method(distances=[], ranges=ranged(lab))
    found = solve(lab, lab.tables(), method)
    np.testing.assert_allclose(lab.errors(found), 0, atol=1e-8)
    assert "known distances give the scale to 0.047 %" in found.notes[0]


@pytest.mark.parametrize(
    "trials",
    [pytest.param(25, marks=pytest.mark.whole), pytest.param(400, marks=pytest.mark.long)],
)
def test_bounds_with_ranges_hold_and_are_the_cramer_rao_bound(trials):
    lab = Lab(3)
    names, rng = lab.names, np.random.default_rng(20_000)
    exact = solve(lab, lab.tables(), lab.method(distances=[], ranges=ranged(lab))).pose
    bound = np.sqrt(np.diag(cross_covariance(exact, names).reshape(24, 24)))
    relative, square = [], []
    for _ in range(trials):
        method = lab.method(distances=[], ranges=ranged(lab, rng))
        found = solve(lab, lab.tables(rng), method)
        covariance = cross_covariance(found.pose, names).reshape(24, 24)
        error = lab.errors(found)
        relative.append(error / bound)
        square.append(error @ np.linalg.solve(covariance, error))
    spread = 1 / np.sqrt(2 * 6 * trials)
    rms = np.sqrt(np.mean(np.square(relative)))
    assert 1 - 4 * spread < rms < (1.05 if trials >= 400 else 1 + 4 * spread)
    assert abs(np.mean(square) - 24) < 4 * np.sqrt(2 * 24 / trials)


def test_ranges_beside_a_distance_make_bounds_smaller():
    lab = Lab(3)
    alone, more = (
        solve(lab, lab.tables(), lab.method(ranges=ranges)).pose["origin_std"].values
        for ranges in ([], ranged(lab, std=2e-4))
    )
    assert (more < alone).all()
    assert more[1, 2] < 0.6 * alone[1, 2]  # above the marks, from where one of them goes


@pytest.mark.whole
def test_a_wrong_range_is_named():
    lab = Lab(5, points=8)
    ranges = ranged(lab, pairs=(("front", 1), ("left", 4), ("right", 2)))
    ranges[1].length += 0.02
    rng = np.random.default_rng(1)
    found = solve(lab, lab.tables(rng), lab.method(ranges=ranges))
    (finding,) = found.findings
    assert (finding.kind, finding.severity.name) == ("wrong_distance", "void")
    assert finding.subject == "distance of view left and point 4"


def test_derivatives_of_ranges_are_those_of_small_steps():
    lab = Lab(3)
    at = Configuration(lab.rotation, lab.origin, lab.points)
    view, point = np.divmod(np.arange(24), 6)
    pairs = np.array([[6, 0], [8, 3], [1, 2]])
    angle = np.zeros((24, 2))
    seen = Sightings(
        view, point, angle, np.full(2, 1e-4), 1.0, 0.03, pairs, np.ones(3), np.full(3, 0.5)
    )
    jacobian = seen.jacobian(at)[-3:]
    for k in range(jacobian.shape[1]):
        step = 1e-6 * np.eye(jacobian.shape[1])[k]
        change = (seen.residual(at.moved(-step)) - seen.residual(at.moved(step)))[-3:] / 2e-6
        np.testing.assert_allclose(jacobian[:, k], change, atol=1e-8)


def trials_of(lab, trials):
    """Errors over the Cramer-Rao bound, their normalised squares, and which intervals cover."""
    names, rng = lab.names, np.random.default_rng(10_000)
    exact = solve(lab, lab.tables(), lab.method()).pose
    bound = np.sqrt(np.diag(cross_covariance(exact, names).reshape(24, 24)))
    relative, square, inside = [], [], []
    for _ in range(trials):
        found = solve(lab, lab.tables(rng), lab.method(rng))
        covariance = cross_covariance(found.pose, names).reshape(24, 24)
        error = lab.errors(found)
        relative.append(error / bound)
        square.append(error @ np.linalg.solve(covariance, error))
        truth = np.abs(error).reshape(4, 6)[:, 3:]
        inside.append(truth <= found.pose["origin_confidence"].values)
    return np.array(relative), np.array(square), np.array(inside)


@pytest.mark.parametrize(
    "trials",
    [pytest.param(25, marks=pytest.mark.whole), pytest.param(400, marks=pytest.mark.long)],
)
def test_six_unknown_points_reach_the_cramer_rao_bound_without_a_start(trials):
    lab = Lab(3)
    relative, square, inside = trials_of(lab, trials)
    # Of the 24 errors, which are correlated, at least the six of one view are independent.
    spread = 1 / np.sqrt(2 * 6 * trials)
    rms = np.sqrt(np.mean(relative**2))
    assert 1 - 4 * spread < rms < (1.05 if trials >= 400 else 1 + 4 * spread)
    assert abs(square.mean() - 24) < 4 * np.sqrt(2 * 24 / trials)
    assert abs(inside.mean() - 0.95) < 4 * np.sqrt(0.05 * 0.95 / (3 * trials))


@pytest.mark.parametrize("seeds", [1, pytest.param(6, marks=pytest.mark.whole)])
@pytest.mark.parametrize("flat", [False, True])
def test_any_six_points_and_four_places_are_found(flat, seeds):
    for seed in range(20, 20 + seeds):
        lab, rng = Lab(seed, flat=flat), np.random.default_rng(seed)
        found = solve(lab, lab.tables(rng), lab.method(rng))
        covariance = cross_covariance(found.pose, lab.names).reshape(24, 24)
        error = lab.errors(found)
        assert error @ np.linalg.solve(covariance, error) < 60  # p = 1e-4
        assert not found.findings


def test_a_wrong_sighting_is_left_out_and_named():
    lab, rng = Lab(5, points=8), np.random.default_rng(0)
    tables = lab.tables(rng)
    right = solve(lab, tables, lab.method())
    tables[2].dac[4] += [30.0, -20.0]
    found = solve(lab, tables, lab.method())
    (finding,) = found.findings
    assert (finding.kind, finding.severity.name) == ("wrong_point", "note")
    assert finding.subject == "point 5 of view right"
    assert "DAC steps beside where the others put it" in finding.text
    assert finding.size == pytest.approx(36, abs=6)
    assert found.registration["used"].sel(view="right", point=5) == 0
    moved = np.abs(found.origin - right.origin)
    assert (moved < 2 * right.pose["origin_std"].values).all()
    assert not right.findings


@pytest.mark.whole
def test_points_with_each_others_angles_are_named():
    lab = Lab(5, points=6)
    tables = lab.tables(np.random.default_rng(0))
    tables[1].dac[[2, 4]] = tables[1].dac[[4, 2]]
    found = solve(lab, tables, lab.method())
    (finding,) = found.findings
    assert (finding.kind, finding.severity.name) == ("exchanged_points", "doubtful")
    assert "point 3 of view left and point 5 of view left seem to be exchanged" in finding.text


@pytest.mark.whole
def test_a_wrong_distance_is_named():
    lab = Lab(5, points=8)
    p = lab.points
    lengths = {(a, b): np.linalg.norm(p[a - 1] - p[b - 1]) for a, b in [(1, 2), (3, 4), (1, 5)]}
    lengths[3, 4] += 0.01
    known = [Distance(list(pair), float(x), 2e-4) for pair, x in lengths.items()]
    found = solve(lab, lab.tables(np.random.default_rng(1)), lab.method(distances=known))
    (finding,) = found.findings
    assert (finding.kind, finding.severity.name) == ("wrong_distance", "void")
    assert finding.subject == "distance of points 3 and 4"


@pytest.mark.whole
def test_errors_larger_than_stated_are_doubted():
    lab = Lab(6, points=8)
    tables = lab.tables(np.random.default_rng(2))
    found = solve(lab, tables, lab.method(pointing=0.2))
    assert {f.kind for f in found.findings} <= {"residuals"}
    assert found.findings[0].severity.name == "doubtful"


def test_points_on_a_plane_seen_twice_allow_two_worlds_and_rough_coordinates_decide():
    lab = Lab(2, views=2, points=8, flat=True)
    tables = lab.tables(np.random.default_rng(3))
    alone = solve(lab, tables, lab.method())
    assert [f.kind for f in alone.findings] == ["other_pose"]
    rough = lab.points + np.random.default_rng(4).normal(0, 0.01, lab.points.shape)
    tables = [replace(t, object_point=rough) for t in tables]
    found = solve(lab, tables, lab.method())
    assert "most like the rough coordinates" in found.findings[0].text
    error = lab.errors(found).reshape(2, 6)[:, 3:]
    assert (np.abs(error) < 5 * found.pose["origin_std"].values).all()


def test_rough_coordinates_make_the_world(tmp_path):
    lab = Lab(9, points=8)
    turn, shift = rotation_towards([1.0, 2.0, 0.5], [0.0, 0.0, 0.0]), np.array([0.3, -0.2, 1.0])
    tables = [replace(t, object_point=lab.points @ turn.T + shift) for t in lab.tables()]
    path = tmp_path / "marks.csv"
    write(path, tables)
    method = Bundle(path=str(path), distances=[Distance([1, 2], lab.length)])
    found = method.estimate(LASER, None, {})
    np.testing.assert_allclose(found.origin, lab.origin @ turn.T + shift, atol=1e-7)
    assert "fit their rough coordinates best" in found.notes[0]
    # Axes in the points' middle are known better than those of three corners.
    corner = solve(lab, lab.tables(), lab.method(distances=method.distances))
    assert (found.pose["origin_std"].mean() < corner.pose["origin_std"].mean()).item()


def test_the_scale_errs_as_the_distance_does():
    lab = Lab(3)
    wide, narrow = (
        solve(lab, lab.tables(), lab.method(distances=[Distance([1, 2], lab.length, std)]))
        for std in (0.003, 0.0)
    )
    share = 0.003 / lab.length
    rise = wide.pose["covariance"].values - narrow.pose["covariance"].values
    # Mirrors an offset apart know a little of the scale, which bends the whole by as little.
    np.testing.assert_allclose(
        np.einsum("vkk->vk", rise)[:, 3:], (share * lab.origin) ** 2, rtol=0.2, atol=1e-12
    )
    assert f"{100 * share:.2g} %" in wide.notes[0]


@pytest.mark.parametrize(
    ("settings", "hidden", "told"),
    [
        ({"distances": []}, (), "needs a known distance, which sets the scale"),
        ({"distances": [Distance([1, 9], 0.3)]}, (), "no two views see a point 9; those that"),
        (
            {"ranges": [MeasuredRange("back", 1, 1.5)]},
            (),
            r"pose.ranges\[0\].view: there is no view back; Valid: below, front",
        ),
        (
            {"ranges": [MeasuredRange("left", 9, 1.5)]},
            (),
            r"pose.ranges\[0\].point: no two views see a point 9",
        ),
        ({"frame": [1, 2, 7]}, (), "pose.frame: no two views see a point 7"),
        ({"frame": []}, (), "no rough coordinates that would make the world's axes"),
        (
            {},
            [("left", n) for n in (1, 2, 3)],
            "view left sees 3 points that another view sees too; its pose needs four",
        ),
        (
            {},
            [(v, n) for v in ("front", "left", "right", "below") for n in (5, 6)],
            "4 points in 4 views are too few",
        ),
    ],
)
def test_bad_input_is_said_in_a_sentence(settings, hidden, told):
    lab = Lab(3)
    with pytest.raises(UserError, match=told) as refused:
        solve(lab, lab.tables(hidden=hidden), lab.method(**settings))
    assert "\n" not in str(refused.value)


def test_a_single_view_is_refused():
    lab = Lab(3)
    with pytest.raises(UserError, match="needs two views or more of the same points, not 1"):
        solve(lab, lab.tables()[:1], lab.method())


def test_a_point_of_one_view_is_left_out_and_said():
    lab = Lab(3, points=7)
    hidden = [(v, 7) for v in ("left", "right", "below")]
    found = solve(lab, lab.tables(hidden=hidden), lab.method())
    (finding,) = found.findings
    assert finding.text.startswith("point 7 is seen from one view alone")
    np.testing.assert_allclose(lab.errors(found), 0, atol=1e-8)


def test_settings_are_checked():
    with pytest.raises(ConfigError, match=r"distances\[0\].points: must be two points"):
        Bundle(distances=[Distance([1], 0.3)])
    with pytest.raises(ConfigError, match="frame: must be three different points"):
        Bundle(frame=[1, 1, 2])
    with pytest.raises(ConfigError, match=r"ranges\[0\].view: must name a view"):
        Bundle(ranges=[MeasuredRange(point=1, length=1.0)])
    with pytest.raises(ConfigError, match=r"ranges\[0\].length: must be a positive number"):
        Bundle(ranges=[MeasuredRange("front", 1)])
