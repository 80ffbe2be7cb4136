"""The table of pose methods: its numbers, its mistakes, and poses from what a person found."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.check import Examination
from sldvexp.check.pose_methods import PoseMethods
from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import KnownPose, rotation_from_euler
from sldvexp.report import closing_table, pose_methods

EULER = np.array([[0.1, 2.9, 0.3], [-1.0, 2.7, 0.2]])
ORIGIN = np.array([[0.1, 0.2, 1.7], [0.3, 0.1, 1.6]])
TRUTH = {
    view: KnownPose(euler=list(e), origin=list(o))
    for view, e, o in zip("ab", EULER, ORIGIN, strict=True)
}


def poses(s, off=0.0, turn=0.0, views="ab"):
    count = len(views)
    about = rotation_from_euler([turn, 0.0, 0.0])
    return dataset.group(
        "pose",
        {"view": list(views)},
        origin=ORIGIN[:count] + np.array([off, 0.0, 0.0]),
        rotation=about @ rotation_from_euler(EULER[:count]),
        s=s,
    )


TREE = {
    "pose": poses([0.1, 0.3], off=0.002, turn=0.001),
    "compare_pose/one": poses([0.5], views="a"),
    "target": dataset.group("target", {"point": [1]}, position=np.zeros((1, 3))),
}


def examined(methods, truth=TRUTH, tree=TREE):
    run = Examination(tree, rng=np.random.default_rng(0))
    return PoseMethods(methods=methods, truth=truth).examine(run)


def test_means_deviations_and_distances():
    found = examined({"both": "pose", "one": "compare_pose/one"})
    np.testing.assert_array_equal(found["views"], [2, 1])
    np.testing.assert_allclose(found["s_mean"], [0.2, 0.5])
    np.testing.assert_allclose(found["s_std"], [np.sqrt(0.02), np.nan])
    np.testing.assert_allclose(found["origin_error"], [0.002, 0.0])
    np.testing.assert_allclose(found["rotation_error"], [0.001, 0.0], atol=1e-12)
    blind = examined({"both": "pose"}, truth={})
    assert set(blind.data_vars) == {"views", "s_mean", "s_std"}


def test_the_table_is_printed(capsys):
    for truth, columns in ((TRUTH, 6), ({}, 4)):
        found = examined({"by hand": "pose", "one": "compare_pose/one"}, truth)
        assert len(pose_methods(found).columns) == columns
        closing_table({"examined/methods": found}, [])
        told = capsys.readouterr().out
        assert "Pose methods" in told
        row = next(line for line in told.splitlines() if "by hand" in line)
        cells = [cell.strip() for cell in row.strip("│ ").split("│")]
        assert cells == ["by hand", "2", "0.2", "0.141", "2", "0.0573"][:columns]


@pytest.mark.parametrize(
    ("methods", "truth", "told"),
    [
        ({"mine": "pos"}, {}, r"methods.mine: the run has no poses pos; did you mean pose\? Valid"),
        ({"mine": "target"}, {}, "methods.mine: the poses target have no error estimate s"),
        (
            {"mine": "pose"},
            {"a": TRUTH["a"]},
            "truth lacks the view b, of which mine has a pose; Valid: a",
        ),
    ],
)
def test_what_is_not_there_is_named(methods, truth, told):
    with pytest.raises(UserError, match=told):
        examined(methods, truth)


def test_mistakes_in_the_configuration():
    with pytest.raises(ConfigError, match="methods: needs a group of poses"):
        PoseMethods()
    with pytest.raises(ConfigError, match=r"truth.a.origin: must be three numbers, not 2"):
        PoseMethods(methods={"a": "pose"}, truth={"a": KnownPose([0.0] * 3, [0.0] * 2)})


BY_HAND = "{plugin: by_hand, views: {a: {}, b: {}}, unit: inch, accuracy: 0.0157, fiducials: {1: {x: 0, y: 0}, 2: {x: 11, y: 0}, 3: {x: 11, y: 11}, 4: {x: 0, y: 11, z: 2}, 5: {x: 3, y: 5, z: 1}}}"  # fmt: skip # noqa: E501
SCENE = [
    "~experiment",
    "scene=plate",
    "instrument=simulated",
    "scene.views={a: {euler: [0.024, 2.910, -3.117], origin: [0.290, 0.530, 1.655]},"
    " b: {euler: [-0.955, 2.695, 2.139], origin: [0.899, 0.564, 1.533]}}",
]


@pytest.mark.whole
def test_named_scans_feed_the_pose_methods_of_their_names(sldvexp):
    spots = "[[-450, -1250], [-450, -50], [450, -650], [300, -300]]"
    done = sldvexp(
        *SCENE,
        f"+compare_scan.hand={BY_HAND}",
        f"+compare_scan.dug={{plugin: by_digitizer, views: {{b: {{dac: {spots}}}}}}}",
        "+compare_pose.hand={plugin: manual}",
        "+compare_pose.dug={plugin: registration}",
    )
    assert done.status == 0, done.err
    tree = done.tree
    assert tree["compare_pose/hand"]["view"].values.tolist() == ["a", "b"]
    assert tree["compare_pose/dug"]["view"].values.tolist() == ["b"]
    assert tree["compare_scan/hand/registration"].sizes["point"] == 5
    assert tree["compare_scan/dug/registration"].sizes["point"] == 4
    for name in ("hand/a", "hand/b", "dug/b"):
        assert list((done.folder / "journal" / "compare_scan" / name).glob("*_1.json"))
    # Bounds of the marks' accuracy and the eye: known beforehand.
    assert np.isinf(tree["compare_pose/hand"]["dof"]).all()
    assert "pose" not in tree.children


@pytest.mark.whole
def test_a_pose_from_the_scan_equals_that_from_its_run(sldvexp):
    scan = ["scan=by_hand", "target=fiducials", "scan.views={a: {}, b: {hidden: [2]}}"]
    one = sldvexp(*SCENE, *scan, "pose=manual")
    assert one.status == 0, one.err
    registration = one.tree["registration"]
    assert "object_point_std" in registration
    path = f"pose.path={one.folder / 'run.nc'}"
    for target in ("target=fiducials", "~target"):
        again = sldvexp("~experiment", "pose=manual", path, target)
        assert again.status == 0, again.err
        for name in ("origin", "covariance", "s"):
            np.testing.assert_array_equal(one.tree["pose"][name], again.tree["pose"][name])


def test_the_mistake_of_a_named_method_is_told_with_its_name(sldvexp):
    done = sldvexp(*SCENE, "+compare_pose.mine={plugin: manual}")
    assert done.status == 1
    assert "compare_pose.mine: pose.path: must name a registration file" in done.err
    done = sldvexp(*SCENE, "+compare_pose.mine={plugin: manul}")
    assert "compare_pose.mine.plugin" in done.err
    assert "did you mean manual?" in done.err
