"""Poses that are known, and poses from digitised triples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from sldvexp import dataset
from sldvexp.check import Examination
from sldvexp.check.pose_equivalence import PoseEquivalence
from sldvexp.check.pose_repeats import PoseRepeats
from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import KnownPose, euler_from_rotation, rotation_from_euler
from sldvexp.pose import Given
from sldvexp.pose.digitised_points import used_readings
from sldvexp.pose.digitizer import Digitizer
from sldvexp.pose.given import _NAMES, read_poses
from sldvexp.report import pose_text
from sldvexp.units import AngleUnit, LengthUnit

EULER, ORIGIN = [-1.149, 2.545, 1.928], [0.871, 0.489, 1.554]
POSTS = {"low": [0.3, -0.25, -0.05], "med": [-0.3, -0.25, 0.1], "high": [0.0, 0.35, -0.2]}
CORNERS = {"a": [0.0, 0.0, 0.0], "b": [0.28, 0.0, 0.0], "c": [0.28, 0.28, 0.0]}
FIGURE_4_29 = """Registration data file name: cmm_pos2.reg
SSE 0.00079, s^2 0.0000, s (deg) 0.0055, s (DAC steps) 0.9039
Parameters - radians and meters
  phi1 = -1.153 +- 0.004
  phi2 =  2.547 +- 0.002
  phi3 =  1.913 +- 0.004
  x0_x =  0.862 +- 0.003
  x0_y =  0.508 +- 0.004
  x0_z =  1.553 +- 0.003
"""


def test_numbers_with_a_sample_size_become_means_with_student_bounds():
    known = KnownPose(EULER, ORIGIN, [0.06, 0.02, 0.05], [0.02, 0.02, 0.006], samples=7)
    pose = Given(views={"front": known}).read().pose
    np.testing.assert_allclose(pose["euler"][0], EULER, rtol=1e-12)
    np.testing.assert_allclose(pose["euler_std"][0], np.array(known.euler_std) / np.sqrt(7))
    factor = stats.t.ppf(0.975, 6)
    np.testing.assert_allclose(
        pose["origin_confidence"][0], factor * np.array(known.origin_std) / np.sqrt(7)
    )


def test_upright_instrument_look_at_a_point():
    at, origin = np.array([0.12, 0.08, 0.0]), np.array([-0.8, -0.1, 1.1])
    pose = Given(views={"left": KnownPose(origin=[*origin], look_at=[*at])}).read().pose
    rotation = pose["rotation"][0].values
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) > 0
    away = np.linalg.norm(at - origin)
    np.testing.assert_allclose(rotation @ (at - origin), [0, 0, away], atol=1e-14)
    assert rotation[0, 1] == pytest.approx(0, abs=1e-15)  # x is level
    assert rotation[1, 1] > 0  # and y goes up


@pytest.mark.parametrize("degrees", [-30.0, 2.0, 90.0])
def test_roll_turns_the_instrument_clockwise_about_the_line_to_that_point(degrees):
    place = {"origin": [-800.0, -100.0, 1100.0], "look_at": [120.0, 80.0, 0.0]}
    level = KnownPose(**place, unit=LengthUnit.mm)
    rolled = KnownPose(**place, unit=LengthUnit.mm, roll=degrees, angle_unit=AngleUnit.deg)
    x, y, ahead = rolled.rotation
    angle = np.deg2rad(degrees)
    np.testing.assert_allclose(ahead, level.rotation[2], atol=1e-14)
    # Who stands behind it has its x axis, which is level, on the left.
    right, up = -level.rotation[0], level.rotation[1]
    np.testing.assert_allclose(x, -np.cos(angle) * right + np.sin(angle) * up, atol=1e-14)
    np.testing.assert_allclose(np.cross(ahead, x), y, atol=1e-14)
    np.testing.assert_allclose(rolled.place, [-0.8, -0.1, 1.1], rtol=1e-15)


def test_angles_may_be_in_degrees():
    known = KnownPose(EULER, ORIGIN, [0.06, 0.02, 0.05], [0.02] * 3)
    deg = {"euler": np.rad2deg(EULER).tolist(), "euler_std": np.rad2deg(known.euler_std).tolist()}
    same = KnownPose(**deg, origin=ORIGIN, origin_std=[0.02] * 3, angle_unit=AngleUnit.deg)
    ours, theirs = (Given(views={"a": pose}).read().pose for pose in (same, known))
    for name in ("euler", "origin", "covariance"):
        np.testing.assert_allclose(ours[name], theirs[name], rtol=1e-12, atol=1e-15)


def test_pose_takes_angles_or_a_point_to_look_at_and_not_the_origin():
    for wrong, told in (
        (KnownPose(EULER, ORIGIN, look_at=[0, 0, 0]), "give either euler or look_at"),
        (KnownPose(origin=ORIGIN), "give either euler or look_at"),
        (KnownPose(origin=ORIGIN, look_at=ORIGIN), "must be another point than the origin"),
        (KnownPose(EULER, ORIGIN, roll=0.1), "views.front.roll: belongs to look_at; euler says it"),
        (KnownPose(origin=ORIGIN, look_at=[0, 0]), "look_at: must be three numbers, not 2"),
        (KnownPose(origin=ORIGIN, look_at=[0, 0, 0], roll=np.nan), "roll: must be finite, not nan"),
    ):
        with pytest.raises(ConfigError, match=told):
            Given(views={"front": wrong})


def test_figure_4_29_is_read_and_written(tmp_path):
    path = tmp_path / "cmm_pos2.txt"
    path.write_text(FIGURE_4_29)
    pose = read_poses(path, 0.95)
    np.testing.assert_allclose(pose["euler"][0], [-1.153, 2.547, 1.913], rtol=1e-12)
    np.testing.assert_allclose(pose["origin_confidence"][0], [0.003, 0.004, 0.003], rtol=1e-12)
    assert "  phi1 = -1.1530 +- 0.0040\n  phi2 =  2.5470 +- 0.0020\n" in pose_text(pose)
    path.write_text(pose_text(pose))
    again = read_poses(path, 0.95)
    np.testing.assert_allclose(again["euler"], pose["euler"], atol=1e-9)
    np.testing.assert_allclose(again["origin_std"], pose["origin_std"], rtol=1e-9)


def test_an_earlier_run_gives_its_pose(sldvexp, run_once):
    first = run_once("experiment=dissertation/registration")
    path = f"pose.path={first}/run.nc"
    without = ("~check.pose_repeats", "~expect.residuals")
    second = sldvexp("experiment=pose", "pose=given", path, *without)
    assert second.status == 0, second.err
    with dataset.load(first / "run.nc") as tree:
        one = tree["pose"].load()
    two = second.tree["pose"]
    for name in ("origin", "rotation", "covariance"):
        np.testing.assert_array_equal(one[name], two[name])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing\n", "there is no pose"),
        ("phi1 = 1\nphi2 = 2\n", "view pose lacks phi3, x0_x, x0_y, x0_z"),
        ("phi1 = one\n", "line 1: phi1 must be a number, not 'one'"),
    ],
)
def test_wrong_texts_are_named(tmp_path, text, message):
    path = tmp_path / "pose.txt"
    path.write_text(text)
    with pytest.raises(UserError, match=message):
        read_poses(path, 0.95)


def test_wrong_numbers_are_collected():
    with pytest.raises(ConfigError) as error:
        Given(views={"a": KnownPose([1.0], [0, 0, np.nan], samples=1)}, confidence=2.0)
    fields = {p.field for p in error.value.problems}
    assert fields == {"confidence", "views.a.euler", "views.a.origin", "views.a.samples"}


def estimate(method):
    """The group ``pose`` of a digitizer's file."""
    return method.estimate(None, None, {}).pose


def digitise(rng, path, noise, repeats=7):
    """A digitizer's file in axes of its own; the pose above is the truth."""
    rotation = rotation_from_euler(EULER)
    axes, shift = rotation_from_euler([0.3, 0.2, -0.1]), np.array([-1.0, 0.4, 2.0])
    posts = {k: rotation.T @ np.array(v) + ORIGIN for k, v in POSTS.items()}
    lines = ["point,x_mm,y_mm,z_mm"]
    for name, world in {**posts, **CORNERS}.items():
        for _ in range(repeats):
            xyz = 1e3 * (axes @ world + shift + noise * rng.standard_normal(3))
            lines.append(",".join([name, *map(repr, xyz.tolist())]))
    path.write_text("\n".join(lines) + "\n")


def test_exact_triples_recover_the_pose(tmp_path):
    path = tmp_path / "d.csv"
    digitise(np.random.default_rng(0), path, 0.0)
    pose = estimate(Digitizer(path=str(path), instrument_points=POSTS, object_points=CORNERS))
    np.testing.assert_allclose(euler_from_rotation(pose["rotation"][0]), EULER, atol=1e-12)
    np.testing.assert_allclose(pose["origin"][0], ORIGIN, atol=1e-12)
    assert pose.attrs["fit_rms"] < 1e-12


def test_plain_table_is_the_same(tmp_path):
    path = tmp_path / "d.csv"
    digitise(np.random.default_rng(1), path, 0.002)
    rows = [line.split(",")[1:] for line in path.read_text().splitlines()[1:]]
    (tmp_path / "d.sev").write_text("\n".join(" ".join(r) for r in rows))
    from sldvexp.units import LengthUnit

    def scaled(points):
        return {k: [1e3 * x for x in v] for k, v in points.items()}

    one = estimate(Digitizer(path=str(path), instrument_points=POSTS, object_points=CORNERS))
    two = estimate(
        Digitizer(str(tmp_path / "d.sev"), LengthUnit.mm, scaled(POSTS), scaled(CORNERS))
    )
    np.testing.assert_allclose(one["origin"], two["origin"], rtol=1e-12)
    np.testing.assert_allclose(one["covariance"], two["covariance"], rtol=1e-6, atol=1e-18)


@pytest.mark.long
def test_bounds_cover_the_truth(tmp_path):
    rng, repeats = np.random.default_rng(2), 300
    inside = []
    for _ in range(repeats):
        digitise(rng, tmp_path / "d.csv", 0.002)
        pose = estimate(
            Digitizer(str(tmp_path / "d.csv"), instrument_points=POSTS, object_points=CORNERS)
        )
        error = np.hstack([pose["euler"][0] - EULER, pose["origin"][0] - ORIGIN])
        bound = np.hstack([pose["euler_confidence"][0], pose["origin_confidence"][0]])
        inside.append(np.abs(error) <= bound)
    # Four standard deviations of a binomial share of 0.95.
    np.testing.assert_allclose(
        np.mean(inside, axis=0), 0.95, atol=4 * np.sqrt(0.95 * 0.05 / repeats)
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace("high,", "hihg,"), "no point is called hihg; did you mean high"),
        (lambda t: "\n".join(t.splitlines()[:-1]), "equally often, but there is"),
        (lambda t: t.replace("x_mm", "x_mn"), "the column x_mm is missing"),
        (lambda t: t.replace("low,", "low,x"), "must be a number"),
    ],
)
def test_wrong_digitizer_files_are_named(tmp_path, change, message):
    path = tmp_path / "d.csv"
    digitise(np.random.default_rng(3), path, 0.001)
    path.write_text(change(path.read_text()))
    with pytest.raises(UserError, match=message):
        estimate(Digitizer(str(path), instrument_points=POSTS, object_points=CORNERS))


def test_points_on_a_line_are_refused(tmp_path):
    path = tmp_path / "d.csv"
    digitise(np.random.default_rng(4), path, 0.001)
    line = {"low": [0.0, 0, 0], "med": [0.1, 0, 0], "high": [0.2, 0, 0]}
    with pytest.raises(UserError, match=r"pose\.instrument_points: the points lie on one line"):
        estimate(Digitizer(str(path), instrument_points=line, object_points=CORNERS))


def judged(path, posts=POSTS, corners=CORNERS):
    """Result of a digitizer's file."""
    method = Digitizer(str(path), instrument_points=posts, object_points=corners)
    return method.estimate(None, None, {})


def changed(path, line, change):
    """Change the numbers of a line of a digitizer's file, which follow its point's name."""
    lines = path.read_text().splitlines()
    name, *xyz = lines[line].split(",")
    lines[line] = ",".join([name, *(repr(x) for x in change(np.array(xyz, float)).tolist())])
    path.write_text("\n".join(lines) + "\n")


def test_a_wrong_reading_is_named_and_its_repeat_left_out(tmp_path):
    path = tmp_path / "d.csv"
    digitise(np.random.default_rng(6), path, 0.002)
    clean = judged(path)
    assert not clean.findings
    changed(path, 3, lambda xyz: xyz + np.array([0, 0, 40]))
    found = judged(path)
    (finding,) = found.findings
    assert finding.kind == "wrong_point"
    assert finding.subject == "view digitizer, point low"
    assert finding.text.startswith("view digitizer: reading 3 of low in d.csv lies 4")
    assert finding.severity.name == "note"
    assert found.pose.attrs["repeats"] == 6
    assert (np.abs(found.origin - clean.origin) < clean.pose["origin_confidence"].values).all()


def test_readings_of_each_others_points_are_called_exchanged(tmp_path):
    path = tmp_path / "d.csv"
    digitise(np.random.default_rng(7), path, 0.002)
    lines = path.read_text().splitlines()
    one, two = lines[2], lines[9]
    lines[2], lines[9] = "low" + two[3:], "med" + one[3:]
    path.write_text("\n".join(lines) + "\n")
    assert [f.kind for f in judged(path).findings] == ["exchanged_points"] * 2


def test_a_digitizer_that_moved_between_repeats_names_no_reading(tmp_path):
    path = tmp_path / "d.csv"
    digitise(np.random.default_rng(8), path, 0.002)
    clean = judged(path)
    for line in range(1, len(path.read_text().splitlines())):
        if (line - 1) % 7 >= 4:
            changed(path, line, lambda xyz: xyz + np.array([300, 0, 0]))
    found = judged(path)
    assert [(f.kind, f.severity.name) for f in found.findings] == [("moved", "note")]
    np.testing.assert_allclose(found.origin, clean.origin, atol=1e-9)


def test_points_that_are_not_as_they_were_digitised_are_named(tmp_path):
    path = tmp_path / "d.csv"
    digitise(np.random.default_rng(9), path, 0.002)
    names = list(POSTS)
    mm = {k: [1e3 * x for x in v] for k, v in POSTS.items()}
    swapped = dict(zip(names, [POSTS[n] for n in (names[1], names[0], *names[2:])], strict=True))
    beside = POSTS | {names[0]: [POSTS[names[0]][0] + 0.03, *POSTS[names[0]][1:]]}
    kinds = {"unit": (mm, "void"), "exchanged_points": (swapped, "void")}
    kinds |= {"shape": (beside, "doubtful")}
    for kind, (posts, severity) in kinds.items():
        (finding,) = judged(path, posts).findings
        assert (finding.kind, finding.severity.name) == (kind, severity)


@pytest.mark.long
def test_right_readings_are_kept_and_wrong_ones_named():
    rng, trials = np.random.default_rng(10), 2000
    points = rng.uniform(-0.25, 0.25, (7, 3))
    for repeats in (3, 7):
        lost = named = 0
        for _ in range(trials):
            digitised = points + 0.003 * rng.standard_normal((repeats, *points.shape))
            lost += not used_readings(digitised)[0].all()
            k, p = rng.integers(repeats), rng.integers(len(points))
            digitised[k, p, 0] += 0.03
            named += np.argwhere(~used_readings(digitised)[0]).tolist() == [[k, p]]
        assert lost <= stats.binom.ppf(0.999, trials, 0.02)
        assert named >= stats.binom.ppf(0.001, trials, 0.95)


def test_one_repeat_says_that_it_has_no_bounds(tmp_path):
    path = tmp_path / "d.csv"
    digitise(np.random.default_rng(5), path, 0.001, repeats=1)
    pose = estimate(Digitizer(str(path), instrument_points=POSTS, object_points=CORNERS))
    assert np.isnan(pose["origin_std"]).all()
    assert "a single repeat gives no bounds" in pose.attrs["notes"]


def kept(path, pose):
    dataset.save({"pose": pose}, {}, path)
    return path


def test_pose_of_a_run_is_given_at_the_asked_level(tmp_path):
    known = KnownPose(EULER, ORIGIN, [0.06, 0.02, 0.05], [0.02, 0.02, 0.006], samples=7)
    first, wanted = (Given(views={"a": known}, confidence=c).read().pose for c in (0.95, 0.68))
    pose = Given(path=str(kept(tmp_path / "run.nc", first)), confidence=0.68).read().pose
    for name in ("euler_confidence", "origin_confidence"):
        np.testing.assert_allclose(pose[name], wanted[name], rtol=1e-12)
        assert pose[name].attrs == wanted[name].attrs
    assert pose.attrs["confidence_level"] == 0.68


@pytest.mark.parametrize("name", ["view", "rotation", "origin", "covariance", "dof", "euler_std"])
def test_group_that_is_no_pose_is_named(tmp_path, name):
    pose = Given(views={"a": KnownPose(EULER, ORIGIN, [0.1] * 3, [0.1] * 3)}).read().pose
    path = kept(tmp_path / "run.nc", pose.drop_vars(name))
    with pytest.raises(UserError, match=f"the group pose lacks {name}$"):
        read_poses(path, 0.95)


def test_bounds_of_zero_are_unknown(tmp_path):
    path = tmp_path / "pose.txt"
    path.write_text("".join(f"{n} = 0.5 +- 0.000\n" for n in _NAMES))
    pose = read_poses(path, 0.95)
    assert np.isnan(pose["euler_std"]).all()
    assert np.isnan(pose["origin_std"]).all()


def test_errors_of_zero_are_not_tested():
    exact = {"a": KnownPose(EULER, ORIGIN, [0.0] * 3, [0.0] * 3)}
    with pytest.raises(UserError, match="no standard errors that are positive and finite"):
        PoseEquivalence(views=exact).examine(
            Examination({"pose": Given(views=exact).read().pose}, rng=None)
        )


def test_repeats_say_how_to_do_without_them():
    with pytest.raises(UserError, match=r"leave the check out with '~check\.pose_repeats'"):
        PoseRepeats().examine(Examination({}, rng=None))
