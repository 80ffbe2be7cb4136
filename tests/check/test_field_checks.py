"""Checks of fields: on fields that are made so that every number is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.check import Examination
from sldvexp.check.field_pattern import FieldPattern
from sldvexp.check.left_out import LeftOut
from sldvexp.check.love import Love
from sldvexp.check.printed import Printed
from sldvexp.check.surface_depth import SurfaceDepth, least_motion
from sldvexp.check.truth import Columns, Truth
from sldvexp.errors import UserError
from sldvexp.field import Iterative
from sldvexp.field.estimate import reconstruct, volume_visibility
from sldvexp.geometry import KnownPose, rotation_from_euler
from sldvexp.laser import TwoMirror, direction_cosines, project
from sldvexp.pose import Given
from sldvexp.reconstruction import Absolute
from sldvexp.verdict.prediction import predict_views
from sldvexp.virtual_lab.modes import Mode
from sldvexp.virtual_lab.plate import Plate, PlateScene, truth_to_dataset
from sldvexp.volume import Grid
from tests.verdict import simulated_views
from tests.verdict.simulated_views import TIGHT

EULER, FREQUENCY = [0.3, 0.5, -0.2], [200.0, 230.0]
#: Through the plate's surface, which is between two of its layers.
VOLUME = Grid(euler=EULER, size=[0.2, 0.15], shape=[5, 4], layers=4, thickness=0.012)
SCENE = PlateScene(
    views={"1": KnownPose([0.0, np.pi, 0.0], [0.0, 0.0, 1.7])},
    plate=Plate(euler=EULER, thickness=0.001, modes={"m": Mode(1, 1, 200.0, 0.02, 0.02)}),
)
NODES = 20


def examined(tree, experiment=None):
    return Examination(tree, rng=np.random.default_rng(0), experiment=experiment)


def field_of(velocity, confidence, components="xyz", **attributes):
    coords = {"component": list(components), "frequency": FREQUENCY[: velocity.shape[-1]]}
    confidence = np.broadcast_to(confidence, velocity.shape)
    both = {"confidence": confidence, "confidence_by_part": np.stack([confidence, confidence])}
    coords["part"] = ["real", "imaginary"]
    group = dataset.group("field", coords, velocity=velocity, **both)
    return group.assign_attrs(attributes)


def tree_of(change=0.0, confidence=0.002):
    """A field that is the truth plus a change of each node, component and frequency, m/s."""
    volume = VOLUME.group()
    truth = truth_to_dataset(SCENE, volume["position"].values, FREQUENCY, 1.0)
    field = field_of(truth["velocity"].values + change, confidence)
    return {"volume": volume, "truth": truth, "field": field}


def test_a_true_field_has_no_error():
    found = Truth().examine(examined(tree_of()))
    np.testing.assert_allclose(found["rms_error"], 0, atol=1e-15)
    np.testing.assert_allclose(found["relative_error"], 0, atol=1e-12)
    assert (found["covered"] == 1).all()
    np.testing.assert_allclose(found["rms_bound"], 0.002)
    assert found.attrs["columns"] == NODES


def test_errors_are_those_on_the_surface():
    """What vanishes on the surface counts for nothing, and what is constant counts in full."""
    height = tree_of()["truth"]["height"].values
    lever = height[:, None, None] * np.array([1.0, 0.0, 0.0])[:, None]
    constant = np.array([0.0, 0.003, 0.001j])[:, None]
    tree = tree_of(lever + constant)
    found = Truth().examine(examined(tree))
    expected = np.array([[0.0], [0.003], [0.001]]) * [1, 1]
    np.testing.assert_allclose(found["rms_error"], expected, atol=1e-15)
    # The real part of y is beyond the bounds; its imaginary part and all of x and z are within.
    np.testing.assert_allclose(found["covered"], [[1, 1], [0.5, 0.5], [1, 1]])
    size = np.sqrt(np.mean(np.abs(_on_surface(tree)) ** 2, axis=0))
    np.testing.assert_allclose(found["relative_error"], expected / size, atol=1e-12)
    in_all = np.linalg.norm(expected, axis=1) / np.linalg.norm(size, axis=1)
    np.testing.assert_allclose(found["relative_error_in_all"], in_all, atol=1e-12)
    np.testing.assert_allclose(found["covered_in_all"], [1, 0.5, 1])


def _on_surface(tree):
    truth = tree["truth"]
    return Columns.from_volume(tree["volume"], truth["height"].values).at_surface(
        truth["velocity"].values
    )


def test_local_components_are_compared_along_each_nodes_frame():
    tree = tree_of()
    frame = np.tile(tree["volume"]["frame"].values, (VOLUME.layers, 1, 1))
    local = np.einsum("nca,naf->ncf", frame, tree["truth"]["velocity"].values)
    local[:, 2] += 0.003
    tree["field"] = field_of(local, 0.002, ("t1", "t2", "n"))
    found = Truth().examine(examined(tree))
    assert found["component"].values.tolist() == ["t1", "t2", "n"]
    np.testing.assert_allclose(found["rms_error"], [[0, 0], [0, 0], [0.003, 0.003]], atol=1e-15)


def test_nodes_without_a_velocity_do_not_count():
    change = np.zeros((VOLUME.layers * NODES, 3, 2))
    change[::NODES, 0] = np.nan
    change[1::NODES, 0] = 0.019
    found = Truth().examine(examined(tree_of(change)))
    # Of 19 columns one is off, in its real part.
    np.testing.assert_allclose(found["rms_error"][0], 0.019 / np.sqrt(19))
    np.testing.assert_allclose(found["covered"][0], 1 - 1 / 38)
    assert (found["covered"][1:] == 1).all()


def test_truth_needs_a_surface_inside():
    with pytest.raises(UserError, match="needs a field and the virtual lab's truth"):
        Truth().examine(examined({"volume": VOLUME.group()}))
    tree = tree_of()
    tree["truth"]["height"] += 0.1
    with pytest.raises(UserError, match=r"outside of the volume: its layers are .* m above it"):
        Truth().examine(examined(tree))


def test_love_measures_the_change_through_the_layers():
    layer = np.repeat([-1.5, -0.5, 0.5, 1.5], NODES)[:, None, None]
    still = np.ones((VOLUME.layers * NODES, 3, 1)) * [[1e-3], [2e-3], [2e-3]]
    velocity = still + 1e-3j * layer * [[0.0], [1.0], [0.0]]
    velocity[::NODES, 2] = np.nan
    run = {"volume": VOLUME.group(), "field": field_of(velocity, 5e-4)}
    found = Love().examine(examined(run))
    size = np.sqrt(np.nanmean(np.abs(velocity) ** 2))
    of_layers = 1e-3 * np.sqrt(1.25)
    np.testing.assert_allclose(found["variation"].squeeze(), [0, of_layers / size, 0], atol=1e-15)
    np.testing.assert_allclose(found["bound"], 5e-4 / size)
    with pytest.raises(UserError, match="there is no field"):
        Love().examine(examined({}))


# --- views left out -------------------------------------------------------------------------------

VIEWS = {
    "1": KnownPose([0.024, 2.910, -3.117], [-0.13, 0.39, 1.655]),
    "2": KnownPose([-0.955, 2.695, 2.139], [0.479, 0.424, 1.533]),
    "3": KnownPose([-0.927, 2.913, 2.202], [0.188, 0.232, 1.656]),
    "4": KnownPose([2.075, 2.988, -1.072], [-0.347, -0.125, 1.680]),
    "5": KnownPose([-1.749, 2.790, 1.403], [0.456, -0.104, 1.596]),
}
LASER, PIXELS, STD = TwoMirror(), 12, 1e-4
MOTION = np.array([0.002, -0.001j, 0.01])


def as_one(x, y):
    """The plate at z = 0 moves as a whole."""
    return np.ones_like(x)[:, None] * MOTION


def session_of(views, added=None, motion=as_one, **volume_settings):
    """Views of a moving plate, and what is added to the image of some, m/s."""
    settings = {"shape": [5, 4], "layers": 3, "thickness": 0.01} | volume_settings
    volume = Grid(size=[0.2, 0.15], **settings)
    tree = {"pose": Given(views=views).read().pose, "volume": volume.group()}
    corners = volume.prisms().position.reshape(-1, 3)
    for name, pose in views.items():
        rotation = rotation_from_euler(pose.euler)
        dac = LASER.dac_from_angle(project((corners - pose.origin) @ rotation.T))
        axes = np.linspace(dac.min(axis=0) - 20, dac.max(axis=0) + 20, PIXELS).T
        pixels = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        along = direction_cosines(LASER.angle_from_dac(pixels), rotation)
        x, y, _ = (pose.origin - along * (pose.origin[2] / along[:, 2:])).T
        velocity = np.einsum("pi,pi->p", along, motion(x, y)) + (added or {}).get(name, 0.0)
        image = dataset.group(
            "image",
            {"pixel": np.arange(len(pixels)), "frequency": [200.0]},
            velocity=velocity[:, None],
            velocity_std=np.full((len(pixels), 1), STD),
            dac=pixels,
            flags=np.zeros(len(pixels), np.uint8),
        )
        tree[f"image/{name}"] = image.assign_attrs(shape=[PIXELS, PIXELS])
    experiment = SimpleNamespace(
        laser=LASER, volume=volume, reconstruction=Absolute(), solver=Iterative()
    )
    return examined(tree, experiment)


@pytest.mark.whole
def test_the_other_views_predict_what_one_measured():
    found = LeftOut().examine(session_of(VIEWS))
    assert found["view"].values.tolist() == list(VIEWS)
    np.testing.assert_allclose(found["measured"], 0.01, rtol=0.1)
    assert (found["error"] < 1e-3 * found["measured"]).all()
    np.testing.assert_allclose(found["noise"], np.sqrt(2) * STD, rtol=1e-9)  # of both parts
    assert (found["expected"] > found["noise"]).all()
    assert not found["named"].any()


@pytest.mark.whole
def test_a_view_that_is_off_is_off_by_as_much_and_named():
    found = LeftOut().examine(session_of(VIEWS, {"4": 0.003j}))
    np.testing.assert_allclose(found["error"].sel(view="4"), 0.003, rtol=1e-2)
    assert found["view"].values[found["named"] == 1].tolist() == ["4"]


@pytest.mark.whole
def test_errors_are_as_large_as_noise_and_poses_let_expect():
    """In the mean of clean sessions, whose poses are drawn from their bounds."""
    square = []
    for seed in range(4):
        made = simulated_views.session(np.random.default_rng(seed), 5, TIGHT, pixels=21)
        groups = simulated_views.groups(made.views)
        found = predict_views(groups, simulated_views.LASER, simulated_views.surface())
        square.append(np.mean((found.error / found.expected) ** 2))
        assert not found.named.any()
    assert abs(np.mean(square) - 1) < 3 * np.std(square, ddof=1) / np.sqrt(len(square))
    assert np.std(square) < 0.1


@pytest.mark.whole
@pytest.mark.parametrize("mistake", ["sign", "gain", "rotation"])
def test_the_wrong_view_is_named_though_it_spoils_the_predictions_of_others(mistake):
    size = {"gain": 0.03, "rotation": np.radians(1.0)}.get(mistake, 0.0)
    made = simulated_views.session(
        np.random.default_rng(5), mistakes={2: mistake}, size=size, pixels=21
    )
    groups = simulated_views.groups(made.views)
    found = predict_views(groups, simulated_views.LASER, simulated_views.surface())
    assert np.flatnonzero(found.named).tolist() == [2]
    assert found.p_value[2] < 1e-6
    assert found.error[2] > 1.5 * found.expected[2]


def test_a_view_can_only_be_left_out_of_four():
    three = dict(list(VIEWS.items())[:3])
    with pytest.raises(UserError, match="predicted from three others at least; 3 have 30 usable"):
        LeftOut().examine(session_of(three))
    with pytest.raises(UserError, match="nothing that they see moves"):
        LeftOut().examine(session_of(VIEWS, motion=lambda x, y: 0 * as_one(x, y)))
    with pytest.raises(UserError, match="check=left_out compares views over a surface"):
        LeftOut().examine(examined({}))


# --- pattern --------------------------------------------------------------------------------------


def solved(std, equations, residual, by_view, cond):
    """A field's group with what the pattern is made of, at two frequencies."""
    coords = {
        "component": list("xyz"),
        "frequency": FREQUENCY,
        "equation": equations,
        "view": list("12345"),
    }
    group = dataset.group(
        "field",
        coords,
        velocity_std=np.ones((4, 1, 1)) * np.array(std)[:, None] * [1.0, 1.0],
        residual_std=np.array(residual)[:, None] * [1.0, 2.0],
        residual_std_by_view=np.array(by_view)[:, None] * [1.0, 2.0],
    )
    return group.assign_attrs(cond=cond)


def test_pattern_is_made_of_ratios():
    tree: dict[str, xr.Dataset] = {
        "field": solved([4, 6, 2], ["all components"], [1.0], [1, 1, 2, 3, 5], 9000.0),
        "compare/decoupled": solved([2, 3, 1], list("xyz"), [3, 4, 2], [1, 1, 1, 1, 1], 180.0),
    }
    found = FieldPattern().examine(examined(tree))
    assert found["field"].values.tolist() == ["field", "decoupled"]
    np.testing.assert_allclose(found["std_ratio"], [[2, 3, 1], [2, 3, 1]])
    np.testing.assert_allclose(found["residual_ratio"], [[np.nan] * 3, [1.5, 2, 1]])
    np.testing.assert_allclose(found["view_ratio"], [[0.5, 0.5, 1, 1.5, 2.5], [1] * 5])
    np.testing.assert_allclose(found["cond_ratio"], [1, 50])
    with pytest.raises(UserError, match="check=field_pattern needs a field"):
        FieldPattern().examine(examined({}))


def test_local_pattern_is_relative_to_the_normal():
    group = solved([4, 6, 2], ["t1", "t2", "n"], [3, 4, 2], [1] * 5, 1.0)
    group = group.assign_coords(component=["t1", "t2", "n"])
    found = FieldPattern().examine(examined({"field": group}))
    np.testing.assert_allclose(found["std_ratio"].sel(field="field"), [2, 3, 1])
    np.testing.assert_allclose(found["residual_ratio"].sel(field="field"), [1.5, 2, 1])


def test_the_print_counts_every_sample_of_a_field_as_a_measurement():
    """Experiment 1 of Table 5.7: F = (16.28 - 12.48) / 441 / (12.48 / 18186)."""

    def fitted(sse, dof):
        coords = {"equation": ["all components"], "frequency": FREQUENCY}
        group = dataset.group("field", coords, sse=[sse])
        return group.assign_attrs(dof=dof, samples=19950)

    tree = {
        "field": fitted([16.28, 28.44], 1323),
        "compare/full": fitted([12.48, 24.50], 1764),
    }
    found = Printed(partial="field", full="compare/full").examine(examined(tree))
    np.testing.assert_allclose(found["f_statistic"], [12.5565, 6.6317], atol=1e-4)
    assert found["f_critical"].item() == pytest.approx(1.1149, abs=5e-5)
    with pytest.raises(UserError, match="there is no compare/ful; did you mean compare/full"):
        Printed(partial="field", full="compare/ful").examine(examined(tree))


# --- depth of the surface -------------------------------------------------------------------------


def bending(middle, components="xyz"):
    """A field that bends about a depth, m: tangential velocity is the distance from it times slope.

    With components of the world the surface is turned, so that they mix.
    """
    rng, volume = np.random.default_rng(3), VOLUME.group()
    slope = rng.normal(size=(2, NODES, 2, 2)) + 1j * rng.normal(size=(2, NODES, 2, 2))
    along = (volume["depth"].values - middle)[:, None, None, None] * slope[0]
    local = np.concatenate([along, np.ones((VOLUME.layers, NODES, 1, 2)) * slope[1][:, :1]], axis=2)
    if components == "xyz":
        local = np.einsum("nca,lncf->lnaf", volume["frame"].values, local)
    velocity = local.reshape(-1, 3, 2)
    return {"volume": volume, "field": field_of(velocity, 0.0, components)}


@pytest.mark.parametrize("components", ["xyz", ("t1", "t2", "n")])
@pytest.mark.parametrize("middle", [-0.005, -0.001, 0.0, 0.002, 0.0055])
def test_a_shell_bends_about_its_middle(middle, components):
    tree = bending(middle, components)
    depth, std, inside = least_motion(tree["field"], tree["volume"], parts=8)
    assert depth == pytest.approx(middle, abs=1e-12)
    assert std < 1e-12
    assert inside


@pytest.mark.parametrize("middle", [-0.0065, 0.0065])
def test_a_middle_outside_of_the_volume_is_told_from_both_sides(middle):
    tree = bending(middle)
    depth, _, inside = least_motion(tree["field"], tree["volume"], parts=8)
    assert depth == pytest.approx(middle, abs=1e-12)
    assert not inside
    views = {"view": ["1", "2", "3"]}
    tree["field"] = tree["field"].assign_coords(views)
    found = SurfaceDepth(parts=8).examine(examined(tree))
    assert found.attrs["notes"] == "the surface lies outside of the volume; move volume.offset"
    assert found["depth"].item() == pytest.approx(middle, abs=1e-12)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("draws", [20, 60])
@pytest.mark.parametrize("middle", [-0.003, 0.003])
def test_the_depths_error_is_the_one_it_says(middle, draws):
    """Over seeds of the noise, within four standard errors of a mean and of a std."""
    found = []
    for seed in range(draws):
        tree = bending(middle)
        noise = np.random.default_rng(seed).normal(size=(2, *tree["field"]["velocity"].shape))
        tree["field"]["velocity"] = tree["field"]["velocity"] + 2e-4 * (noise[0] + 1j * noise[1])
        found.append(least_motion(tree["field"], tree["volume"], parts=16)[:2])
    depth, std = np.array(found).T
    assert depth.mean() == pytest.approx(middle, abs=4 * depth.std() / np.sqrt(draws))
    assert std.mean() == pytest.approx(depth.std(), rel=4 / np.sqrt(2 * draws) + 0.1)


def seen_bending(given, offset):
    """Views of a thin plate at z = 0 that bends; the given surface is at `given`, m."""

    def waves(x, y):
        return 0.01 * np.sin(12 * x + 9 * y + 0.4)[:, None] * [0.0, 0.0, 1.0]

    run = session_of(
        VIEWS,
        motion=waves,
        shape=[9, 8],
        layers=4,
        thickness=0.016,
        offset=offset,
        center=[0.0, 0.0, given],
    )
    e = run.experiment
    visibility = volume_visibility(run.groups, e.laser, e.volume)
    field = reconstruct(run.groups, visibility, e.volume, e.reconstruction, e.solver)
    return examined(run.groups | {"field": field}, e)


@pytest.mark.one_in(6)
@pytest.mark.parametrize("offset", [-0.002, 0.0, 0.002])
@pytest.mark.parametrize("given", [-0.004, 0.004])
def test_the_real_surface_is_found_on_both_sides_of_the_given_one(given, offset):
    found = SurfaceDepth().examine(seen_bending(given, offset))
    # Pixels 17 mm apart leave 0.03 mm, a quarter of it with twice as many. Views disagree by the
    # fourth power of the depth, which says less.
    assert found["depth"].item() == pytest.approx(-given, abs=0.00005)
    assert found["agreement_depth"].item() == pytest.approx(-given, abs=0.003)
    assert found.attrs["notes"] == ""
    with pytest.raises(UserError, match="there is no field"):
        SurfaceDepth().examine(examined({}))
