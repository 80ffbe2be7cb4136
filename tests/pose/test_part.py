"""Pose from the outline of a part: bounds, other shapes, wrong edges, and what cannot be told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, norm

import sldvexp
from sldvexp.config.composing import made_from
from sldvexp.errors import UserError
from sldvexp.geometry import (
    rotation_from_euler,
    rotation_from_vector,
    rotation_towards,
    vector_from_rotation,
)
from sldvexp.image import ScanLineEdges
from sldvexp.laser import PartOutline, TwoMirror
from sldvexp.pose.part import Part
from sldvexp.session.circles import edges_to_dataset

LASER = TwoMirror(mirror_offset=0.03)
ORIGIN = np.array([0.6, 0.35, 1.05])
ROTATION = rotation_towards(ORIGIN, [0.02, 0.01, 0.0])
#: Corners of a plate, m; the second has a step in its outline.
PLATE = [(-0.15, -0.125), (0.15, -0.125), (0.15, 0.125), (-0.15, 0.125)]
STEPPED = [*PLATE[:3], (-0.05, 0.125), (-0.05, 0.06), (-0.15, 0.06)]


def obj(path, corners, scale=1.0):
    """A mesh file of a plane face."""
    lines = [f"v {scale * x} {scale * y} 0" for x, y in corners]
    faces = {4: ["f 1 2 3 4"], 6: ["f 1 2 5 6", "f 2 3 4 5"]}[len(corners)]
    path.write_text("\n".join([*lines, *faces]) + "\n")
    return str(path)


def mesh(corners):
    """The same as the lab has it."""
    position = np.pad(np.array(corners), ((0, 0), (0, 1)))
    triangles = [[0, 1, 2], [0, 2, 3]]
    if len(corners) == 6:
        triangles = [[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4]]
    return PartOutline.from_mesh(position, np.array(triangles))


def scanned(part, path, rng=None, std=0.02, pointing=0.0, lines=60, pose=(ROTATION, ORIGIN)):
    """Edges of a part's outline, exact or with noise, and a rough pose 2 cm and 1 deg beside."""
    point, outward = part.outline(*pose, LASER, lines)
    found = part.crossings(point, outward, *pose, LASER, 5.0)
    along = found.along.copy()
    if rng is not None:
        along += np.hypot(std, pointing) * rng.standard_normal(len(along))
    place = point[found.line] + along[:, None] * outward[found.line]
    count = len(place)
    edges = ScanLineEdges(
        position=LASER.dac_from_angle(place * LASER.step),
        std=np.full(count, std),
        direction=outward[found.line],
        width=np.zeros(count),
        line=np.arange(count),
        rising=np.zeros(count, bool),
        phase=np.zeros(count),
        rejected=(),
        lines=count,
        name="the outline",
    )
    group = edges_to_dataset([edges])
    group.attrs |= {
        "part": path,
        "part_unit": "m",
        "rough_rotation": (rotation_from_vector([0.015, -0.01, 0.012]) @ pose[0]).ravel(),
        "rough_origin": pose[1] + [0.02, -0.015, 0.01],
    }
    return group


def solve(group, **settings):
    return Part(**settings).estimate(LASER, None, {"edge/front": group})


def error(found):
    turned = vector_from_rotation(found.rotation[0] @ ROTATION.T)
    return np.concatenate([turned, found.origin[0] - ORIGIN])


def mean_square_between(trials):
    """Limits, four standard errors away, of a mean of squares of six errors in their own units.

    Of few trials they are far from those of a normal distribution, whose lower one is negative.
    """
    return chi2.ppf(norm.cdf([-4, 4]), 6 * trials) / trials


@pytest.fixture(scope="module")
def stepped(tmp_path_factory):
    return obj(tmp_path_factory.mktemp("part") / "stepped.obj", STEPPED)


@pytest.fixture(scope="module")
def right(stepped):
    """What edges of the part as it is give; nobody changes it."""
    return solve(scanned(mesh(STEPPED), stepped, np.random.default_rng(2)))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("pointing", [0.0, 0.06])
@pytest.mark.parametrize(
    "trials",
    [pytest.param(6, marks=pytest.mark.whole), pytest.param(200, marks=pytest.mark.long)],
)
def test_bounds_cover_the_truth(stepped, trials, pointing):
    rng, part = np.random.default_rng(1), mesh(STEPPED)
    square, inside, alarms = [], [], 0
    for _ in range(trials):
        found = solve(scanned(part, stepped, rng, pointing=pointing), hysteresis=0.0)
        pose, away = found.pose.isel(view=0), error(found)
        square.append(away @ np.linalg.solve(pose["covariance"].values, away))
        inside.append(np.abs(away[3:]) <= pose["origin_confidence"].values)
        alarms += sum(f.kind == "outline" for f in found.findings)
    # Without pointing the stated errors are a little more than enough: it is never negative.
    low, high = mean_square_between(trials)
    assert low - 0.4 < np.mean(square) < high + 0.4
    share = np.mean(inside)
    assert abs(share - 0.95) < 4 * np.sqrt(0.05 * 0.95 / trials)
    assert alarms <= 1 + 0.01 * trials + 4 * np.sqrt(0.01 * trials)


@pytest.mark.whole
@pytest.mark.parametrize(
    "trials",
    [2, pytest.param(10, marks=pytest.mark.whole), pytest.param(200, marks=pytest.mark.long)],
)
def test_edges_that_hysteresis_displaces_alike_are_in_the_bounds(stepped, trials):
    rng, part, hysteresis = np.random.default_rng(9), mesh(STEPPED), 2e-5
    square, without = [], []
    for _ in range(trials):
        group = scanned(part, stepped, rng)
        along = group["direction"].values
        lag = hysteresis / 2 * rng.standard_normal() * np.sign(along) / LASER.step
        group["dac"][:] += lag
        for told, found in ((hysteresis, square), (0.0, without)):
            pose = solve(group, hysteresis=told)
            away = error(pose)
            found.append(away @ np.linalg.solve(pose.pose["covariance"].values[0], away))
    # Residuals show some of it, and take that for pointing besides: bounds are rather too large.
    low, high = mean_square_between(trials)
    assert 3.5 / 6 * low < np.mean(square) < high
    assert np.mean(without) > 2 * np.mean(square)


@pytest.mark.whole
def test_pointing_noise_is_estimated(stepped):
    group = scanned(mesh(STEPPED), stepped, np.random.default_rng(3), 0.02, 0.08, lines=200)
    found = solve(group)
    # Of 200 residuals a standard deviation is known to 5 %.
    assert found.pose["pointing_std"].item() == pytest.approx(0.08, rel=0.2)


def test_wrong_edges_are_left_out_and_counted(stepped, right):
    group = scanned(mesh(STEPPED), stepped, np.random.default_rng(2))
    group["dac"][5:8] += 8.0 * group["direction"][5:8]
    found = solve(group)
    (finding,) = found.findings
    assert (finding.kind, finding.severity.name) == ("wrong_edges", "note")
    assert finding.text.startswith("view front: 3 of 60 edges lie beside the outline, up to 8")
    assert (np.abs(error(found) - error(right))[3:] < found.pose["origin_std"][0]).all()


def test_a_part_of_another_shape_is_told(stepped, right):
    # The right edge stands askew by 0.4 mm along its length.
    other = [*STEPPED[:1], (0.1504, -0.125), *STEPPED[2:]]
    group = scanned(mesh(other), stepped, np.random.default_rng(4))
    found = solve(group)
    kinds = {f.kind for f in found.findings}
    assert "outline" in kinds
    told = next(f for f in found.findings if f.kind == "outline")
    assert "as if the part had another shape or size" in told.text
    assert not right.findings


def test_half_turns_of_a_symmetric_part_are_said(tmp_path, right):
    path = obj(tmp_path / "plate.obj", PLATE)
    found = solve(scanned(mesh(PLATE), path, np.random.default_rng(5)))
    np.testing.assert_allclose(error(found), 0, atol=3e-4)
    assert "after half a turn the part looks the same, so that 3 other places" in found.notes[0]
    assert not right.notes


def test_a_rough_pose_on_the_wrong_side_of_the_normal_is_put_right(tmp_path, stepped):
    group = scanned(mesh(STEPPED), stepped, np.random.default_rng(6))
    # A plane part looks nearly the same from where it is mirrored in depth.
    group.attrs["rough_origin"] = ORIGIN * [-0.3, -0.3, 1.0]
    group.attrs["rough_rotation"] = rotation_towards(ORIGIN * [-0.3, -0.3, 1.0], [0, 0, 0]).ravel()
    try:
        found = solve(group)
    except UserError as refused:
        assert "the rough pose, the mesh or its unit is wrong" in str(refused)  # noqa: PT017
    else:
        np.testing.assert_allclose(error(found), 0, atol=5e-4)


def test_a_mesh_in_millimetres_is_refused_with_its_unit(tmp_path):
    path = obj(tmp_path / "plate.obj", PLATE, scale=1000.0)
    group = scanned(mesh(PLATE), path)
    with pytest.raises(UserError, match=r"the part is 300 m large in m .* is it in mm\?"):
        solve(group)
    group.attrs["part_unit"] = "mm"
    np.testing.assert_allclose(error(solve(group)), 0, atol=1e-8)


def test_another_mesh_than_the_scan_had_may_be_named(tmp_path):
    rough = obj(tmp_path / "rough.obj", [(x * 1.02, y) for x, y in PLATE])
    right = obj(tmp_path / "right.obj", PLATE)
    group = scanned(mesh(PLATE), rough)
    np.testing.assert_allclose(error(solve(group, path=right)), 0, atol=1e-8)


def test_edges_of_something_else_are_refused(stepped):
    group = scanned(mesh(STEPPED), stepped)
    group["dac"][:] += [1500.0, 1500.0]
    with pytest.raises(UserError, match="view front: the outline of the part meets"):
        solve(group)


def test_a_view_that_cannot_be_solved_does_not_end_the_others(stepped):
    good, bad = scanned(mesh(STEPPED), stepped), scanned(mesh(STEPPED), stepped)
    bad["dac"][:] += [1500.0, 1500.0]
    found = Part().estimate(LASER, None, {"edge/front": good, "edge/left": bad})
    assert found.views == ["front"]
    assert [(f.kind, f.subject) for f in found.findings] == [("no_pose", "view left")]


def test_scans_of_circles_are_no_outline(stepped):
    group = scanned(mesh(STEPPED), stepped)
    del group.attrs["part"]
    with pytest.raises(UserError, match="choose scan=outline"):
        solve(group)


def session(seed, folder, *settings):
    """Errors (view, 6), rad and m, of a whole session of the experiment, with their covariances."""
    whole = ("experiment=part_pose", f"seed={seed}", *settings)
    tree = sldvexp.run(*whole, "report=none", f"hydra.run.dir={folder / str(seed)}", quiet=True)
    pose, views = tree["pose"].to_dataset(), made_from(whole).scene.views
    errors = []
    for name in pose["view"].values:
        own = pose.sel(view=name)
        turn = own["rotation"].values @ rotation_from_euler(views[name].euler).T
        errors.append([*vector_from_rotation(turn), *(own["origin"].values - views[name].origin)])
    return np.array(errors), pose["covariance"].values


@pytest.mark.long
@pytest.mark.parametrize(
    ("seeds", "largest", "settings"),
    [
        (4, 3e-4, ["scene.pointing=modern"]),
        # At 72 lines their mirrors' noise leaves a standard deviation of 0.5 mm, and no less.
        (4, None, ["scene.pointing=chapter_4"]),
        (2, 3e-4, ["scene.pointing=chapter_4", "scan.lines=1152"]),
    ],
)
def test_whole_sessions_lie_within_their_bounds(tmp_path, seeds, largest, settings):
    square = []
    for seed in range(seeds):
        errors, covariance = session(seed, tmp_path, *settings)
        square += [e @ np.linalg.solve(c, e) for e, c in zip(errors, covariance, strict=True)]
        if largest is not None:
            assert np.abs(errors).max() < largest
    count = 6 * len(square)
    assert abs(np.sum(square) - count) < 4 * np.sqrt(2 * count)
