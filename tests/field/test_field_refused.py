"""What no field can be made of: one sentence that says what, where, and what would be right."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.config.registry import get
from sldvexp.errors import UserError
from sldvexp.field import View, VolumeVisibility
from sldvexp.field.estimate import reconstruct, solve_field, volume_visibility
from sldvexp.laser import TwoMirror
from sldvexp.pose import pose_to_dataset
from sldvexp.reconstruction import Reconstruction
from sldvexp.signal import Flag
from sldvexp.volume import Grid, SampleRule, SampleSettings, VisibilitySettings

Make = Callable[..., Any]
Tree = dict[str, xr.Dataset]
PIXELS, FREQUENCY = 20, [200.0]
VOLUME = Grid(size=[0.3, 0.3], shape=[4, 4], layers=3, thickness=0.02)


def image_of(view: View, frequency: list[float] = FREQUENCY) -> xr.Dataset:
    """An image of noise alone."""
    rng = np.random.default_rng(int(view.name))
    velocity = rng.normal(size=(len(view.dac), len(frequency), 2)) @ [1e-3, 1e-3j]
    group = dataset.group(
        "image",
        {"pixel": np.arange(len(view.dac)), "frequency": frequency},
        velocity=velocity,
        velocity_std=np.full(velocity.shape, 1e-3),
        dac=view.dac,
        flags=view.flags.astype(np.uint8),
    )
    return group.assign_attrs(shape=list(view.shape or ()))


def poses_of(views: list[View]) -> xr.Dataset:
    covariance = np.tile(1e-8 * np.eye(6), (len(views), 1, 1))
    rotation, origin = [v.rotation for v in views], [v.origin for v in views]
    return pose_to_dataset(
        [v.name for v in views], rotation, origin, covariance, [np.inf] * len(views), 0.95
    )


def session(views: list[View]) -> Tree:
    return {"pose": poses_of(views)} | {f"image/{v.name}": image_of(v) for v in views}


def method_of(name: str, **fields: Any) -> Reconstruction:
    method: Reconstruction = get("reconstruction", name)(**fields)
    return method


def field(
    tree: Tree, laser: TwoMirror, volume: Grid = VOLUME, name: str = "absolute", **fields: Any
) -> xr.Dataset:
    looks = volume_visibility(tree, laser, volume)
    solver = get("solver", "direct")()
    return reconstruct(tree, looks, volume, method_of(name, **fields), solver)


def changed(tree: Tree, view: str, **variables: Any) -> Tree:
    """The session with another image of one view."""
    image = tree[f"image/{view}"].copy()
    for name, values in variables.items():
        image[name] = image[name].copy(data=values)
    return tree | {f"image/{view}": image}


def without(tree: Tree, *names: str) -> Tree:
    return {name: group for name, group in tree.items() if name not in names}


def flagged(tree: Tree, view: str, flag: Flag, part: float = 1.0) -> Tree:
    """The session with a flag at that part of a view's pixels."""
    flags = np.random.default_rng(3).random(PIXELS**2) < part
    return changed(tree, view, flags=(flags * flag).astype(np.uint8))


def refused(work: Callable[[], object]) -> str:
    """The sentence, which is one."""
    with pytest.raises(UserError) as error:
        work()
    told = str(error.value)
    assert "\n" not in told
    assert "nan" not in told.split()
    return told


def test_the_session_itself_is_sound(make_views: Make, laser: TwoMirror) -> None:
    found = field(session(make_views(4, PIXELS)), laser)
    assert np.isfinite(found["velocity"]).all()
    assert found["observable"].all()
    assert not found.attrs["notes"].startswith("samples")


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("count", "name", "fields", "message"),
    [
        (2, "absolute", {}, "three components anywhere; 3 are needed, so take more views"),
        (1, "absolute", {}, "three components anywhere; 3 are needed, so take more views"),
        (3, "relative", {}, "2 independent ones, which cannot determine three components"),
        (2, "combined", {}, "2 views do not have 3 independent rows of this method; more views"),
        (2, "contravariant", {}, "2 views do not have 3 independent rows"),
        (3, "absolute", {"model": "full"}, "at least 4 rows are needed, but there are 3: 1,2,3"),
        (3, "contravariant", {"model": "full"}, "3 views do not have 4 independent rows"),
        (4, "absolute", {"rows": "1,2"}, "2 independent ones, which cannot determine three"),
        (4, "absolute", {"rows": "1,2,7"}, "7"),
    ],
)
def test_fewer_views_than_the_method_needs(
    make_views: Make, laser: TwoMirror, count: int, name: str, fields: dict[str, Any], message: str
) -> None:
    from sldvexp.reconstruction import Model

    if "model" in fields:
        fields = fields | {"model": Model[fields["model"]]}
    tree = session(make_views(count, PIXELS))
    assert message in refused(lambda: field(tree, laser, name=name, **fields))


def test_copied_images_and_poses(make_views: Make, laser: TwoMirror) -> None:
    views = make_views(5, PIXELS)
    tree = session(views)
    # A file that was copied with its pose, or with another one.
    pose = poses_of([*views[:4], replace(views[0], name="5")])
    told = refused(lambda: field(tree | {"pose": pose}, laser))
    assert told == (
        "views 1 and 5 have the same pose: they see the same component of the velocity; leave "
        "one out, or move the instrument"
    )
    told = refused(lambda: field(tree | {"image/4": tree["image/2"]}, laser))
    assert told == (
        "views 2 and 4 have the same image, pixel by pixel, from different places; give each "
        "view its own"
    )
    # Nothing moves: all images are alike, and right.
    still = tree
    for view in "12345":
        still = changed(still, view, velocity=np.zeros((PIXELS**2, 1), complex))
    assert not field(still, laser)["velocity"].any()


def test_views_that_are_nearly_alike_name_the_directions(
    make_views: Make, laser: TwoMirror
) -> None:
    """All from one place: one direction is known, which is no component's, and two are not."""
    first = make_views(1, PIXELS)[0]
    near = [replace(first, name=str(k + 1), origin=first.origin + 1e-5 * k) for k in range(4)]
    told = refused(lambda: field(session(near), laser))
    assert "nothing is determined anywhere by the rows 1,2,3,4; 48 of 48 nodes are seen in" in told
    assert "the first is node 0 (from 0) at (-0.15, -0.15, -0.01) m" in told
    assert told.count("(") >= 4  # two directions
    assert told.endswith("in x, y, z is not determined")


def in_a_plane(make_views: Make, across: float = 0.0) -> list[View]:
    """Four views from places in the plane y = 0, the last a little outside of it."""
    first = make_views(1, PIXELS)[0]
    found = []
    for k, x in enumerate([-0.5, 0.0, 0.5, 0.25]):
        origin = np.array([x, across if k == 3 else 0.0, 1.6])
        z = -origin / np.linalg.norm(origin)
        side = np.cross([0.0, 1.0, 0.0], z)
        side /= np.linalg.norm(side)
        rotation = np.stack([side, np.cross(z, side), z])
        axes = np.linspace(-1400, 1400, PIXELS)
        dac = np.stack(np.meshgrid(axes, axes, indexing="ij"), axis=-1).reshape(-1, 2)
        found.append(replace(first, name=str(k + 1), origin=origin, rotation=rotation, dac=dac))
    return found


def test_views_in_a_plane_determine_what_lies_in_it(make_views: Make, laser: TwoMirror) -> None:
    """On the plane of four views the component across is flagged, and the two others are given."""
    offset = replace(laser, mirror_offset=0.0)
    thin = replace(VOLUME, size=[0.3, 1e-6], shape=[4, 2])
    found = field(session(in_a_plane(make_views)), offset, thin)
    np.testing.assert_array_equal(found["observable"], [[True, False, True]] * thin_nodes(thin))
    assert np.isfinite(found["velocity"].sel(component=["x", "z"])).all()
    assert np.isnan(found["velocity"].sel(component="y")).all()
    assert np.isnan(found["confidence"].sel(component="y")).all()
    np.testing.assert_array_equal(found["flagged_rank"], 2)
    lost = found["flagged_direction"].values[:, 2]
    np.testing.assert_allclose(np.abs(lost @ [0.0, 1.0, 0.0]), 1.0, atol=1e-3)
    assert "24 of 24 nodes are seen in some directions only" in found.attrs["notes"]
    assert "1.00, 0.00) in x, y, z is not determined" in found.attrs["notes"]
    out = field(session(in_a_plane(make_views, across=0.1)), offset, thin)
    assert out["observable"].all()


def thin_nodes(volume: Grid) -> int:
    return volume.prisms().nodes


def test_mirrored_views(make_views: Make, laser: TwoMirror) -> None:
    """A pose that is a mirror image is none; one behind the surface sees its back."""
    views = make_views(4, PIXELS)
    mirrored = poses_of(views)
    mirrored["rotation"][2] = mirrored["rotation"][2] * np.array([[-1.0], [1.0], [1.0]])
    told = refused(lambda: field(session(views) | {"pose": mirrored}, laser))
    assert told == "view 3: the rotation of the pose is not a proper rotation matrix"
    flip = np.diag([1.0, 1.0, -1.0])
    inside = np.diag([1.0, -1.0, 1.0])  # keeps it a rotation
    behind = replace(
        views[0],
        name="5",
        origin=flip @ views[0].origin,
        rotation=inside @ views[0].rotation @ flip,
    )
    told = refused(lambda: field(session([*views, behind]), laser))
    assert told.startswith("view 5: none of the samples is seen; view 5: 216 of 216 samples are ")
    assert told.endswith("do the surface's normals point to the side that is measured?")
    # What moves along the line between two opposite views is all that they know of.
    both = replace(VOLUME, sight=VisibilitySettings(both_sides=True))
    opposite = replace(
        views[0],
        name="5",
        origin=-views[0].origin,
        rotation=np.diag([-1, 1, -1]) @ views[0].rotation,
    )
    wide = np.linspace(-1500, 1500, PIXELS)
    dac = np.stack(np.meshgrid(wide, wide, indexing="ij"), axis=-1).reshape(-1, 2)
    some = [replace(v, dac=dac) for v in (views[0], opposite)]
    assert "2 independent ones" in refused(lambda: field(session(some), laser, both))
    result = field(session([*views[1:3], *some]), laser, both)
    assert result["observable"].all()


def test_poses_that_are_missing(make_views: Make, laser: TwoMirror) -> None:
    views = make_views(4, PIXELS)
    tree = session(views)
    told = refused(lambda: field(tree | {"pose": poses_of(views[:3])}, laser))
    assert told == (
        "view 4: has an image but no pose; Valid: 1, 2, 3; find the pose of that view too, or "
        "leave its image out"
    )
    told = refused(lambda: field(without(tree, "pose"), laser))
    assert told == "field: the images of 1, 2, 3, 4 have no poses; choose a pose"
    unknown = poses_of(views)
    unknown["origin"][1] = np.nan
    told = refused(lambda: field(tree | {"pose": unknown}, laser))
    assert told == "view 2: the origin of the pose is not three finite numbers"
    told = refused(lambda: field({"pose": tree["pose"]}, laser))
    assert told == "field: there are no velocity images; scan the structure from some views"
    # A pose that was solved for no image is no harm.
    assert field(without(tree, "image/4"), laser)["view"].values.tolist() == ["1", "2", "3"]


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ([0.65, 0.0, 0.0], "samples are outside the image, its image has up_down -"),
        ([0.0, 0.0, 9.0], "samples are behind the instrument, no sample has an image point; is"),
        ([3.0, 0.0, 0.0], "samples are off the board, no sample has an image point; is the pose"),
    ],
)
def test_volume_outside_every_image(
    make_views: Make, laser: TwoMirror, place: list[float], message: str
) -> None:
    told = refused(
        lambda: field(session(make_views(4, PIXELS)), laser, replace(VOLUME, center=place))
    )
    assert told.startswith("the volume is seen by none of the views; view 1: ")
    assert message in told
    assert "placed in the world of the poses" in told
    assert "volume.unit" in told


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda v, t: t | {"image/3": image_of(v, [201.0])},
            "view 3: its frequencies (201 Hz, 1 in all) are not those of view 1 (200 Hz, 1 in "
            "all); all views must be taken at the same ones",
        ),
        (
            lambda v, t: t | {"image/3": image_of(v, [200.0, 300.0])},
            "view 3: its frequencies (200, 300 Hz, 2 in all) are not those of view 1 (200 Hz, 1 "
            "in all); all views must be taken at the same ones",
        ),
        (
            lambda v, t: t | {"image/3": t["image/3"].isel(frequency=0, drop=True)},
            "view 3: its frequencies (none stated) are not those of view 1 (200 Hz, 1 in all); "
            "all views must be taken at the same ones",
        ),
        (
            lambda v, t: t | {"image/3": with_unit(t["image/3"], "mm/s")},
            "view 3: its velocities are in mm/s; they must be in m/s",
        ),
        (
            lambda v, t: t | {"image/3": with_unit(t["image/3"], None)},
            "view 3: its velocities are in no unit; they must be in m/s",
        ),
    ],
)
def test_frequencies_and_units_of_each_view(
    make_views: Make, laser: TwoMirror, change: Callable[[View, Tree], Tree], message: str
) -> None:
    views = make_views(4, PIXELS)
    assert refused(lambda: field(change(views[2], session(views)), laser)) == message


def with_unit(image: xr.Dataset, unit: str | None) -> xr.Dataset:
    image = image.copy()
    image["velocity"].attrs = {} if unit is None else {"units": unit}
    return image


@pytest.mark.parametrize(
    ("flag", "remedy"),
    [
        (Flag.saturated, "choose a wider range"),
        (Flag.dropped_out, "raise signal.flags.dropout_factor"),
        (Flag.reference_missing, "lower signal.flags.reference_minimum"),
        (Flag.non_finite, "samples that are no numbers"),
        (Flag.poor_fit, "is scan.sampling.frequency the one that is driven"),
    ],
)
def test_all_flagged_images(make_views: Make, laser: TwoMirror, flag: Flag, remedy: str) -> None:
    tree = session(make_views(4, PIXELS))
    told = refused(lambda: field(flagged(tree, "3", flag), laser))
    start = f"view 3: 400 of 400 pixels are flagged ({flag.name} 400): "
    assert told.startswith(start)
    assert remedy in told
    assert told.endswith("or leave the view out")


def test_pixels_that_are_flagged_for_their_reference(make_views: Make, laser: TwoMirror) -> None:
    """Where samples are too few because of flags it is the flags that are told, with counts."""
    tree = session(make_views(4, PIXELS))
    most = tree
    for view in "1234":
        most = flagged(most, view, Flag.reference_missing, 0.45)
    told = refused(lambda: field(most, laser))
    assert "samples are at flagged pixels" in told
    count = int((most["image/1"]["flags"] != 0).sum())
    reason = f"{4 * count} of 1600 pixels are flagged (reference_missing {4 * count})"
    assert f"{reason}: connect the reference to its channel, or lower signal.flags." in told
    # One view alone says it too, and in a field that there is otherwise, a note does.
    told = refused(lambda: field(flagged(tree, "2", Flag.dropped_out, 0.9), laser))
    assert told.startswith("view 2: none of the samples is seen; view 2: 216 of 216 samples are fl")
    assert "pixels are flagged (dropped_out 3" in told
    half = tree
    for view in "1234":
        here = half[f"image/{view}"]["dac"].values[:, 0] > 0
        half = changed(half, view, flags=(here * 4).astype(np.uint8))
    notes = field(half, laser).attrs["notes"].splitlines()
    assert "nodes are not seen well enough to determine anything" in notes[0]
    assert notes[-1].startswith("samples are at flagged pixels, ")
    count = sum(int((half[f"image/{view}"]["flags"] != 0).sum()) for view in "1234")
    assert f": {count} of 1600 pixels are flagged (reference_missing {count})" in notes[-1]


def test_a_singular_system_names_its_nodes(make_views: Make, laser: TwoMirror) -> None:
    tree = session(make_views(4, PIXELS))
    told = refused(lambda: field(tree, laser, replace(VOLUME, samples=SampleSettings(1, 2))))
    assert "too few to determine the surface nodes 0, 1, 2, 3, 4 and 11 others one by one" in told
    assert told.endswith("use more points in each triangle, as with samples.triangle=3")
    told = refused(lambda: field(tree, laser, replace(VOLUME, samples=SampleSettings(3, 1))))
    assert told.endswith("the layers above and below them one by one; use samples.line=2 or more")
    # With flagged pixels it is not the number of points alone.
    for view in "1234":
        tree = flagged(tree, view, Flag.reference_missing, 0.15)
    told = refused(lambda: field(tree, laser, replace(VOLUME, samples=SampleSettings(1, 2))))
    assert told.startswith("field: samples are at flagged pixels, ")
    assert "lower signal.flags.reference_minimum" in told
    assert "; without those the samples are too few to determine the surface nodes " in told


def small(
    make_plate: Make, make_views: Make, laser: TwoMirror, rule: SampleRule
) -> VolumeVisibility:
    """Views that see unequally well, so that the matrix is no Kronecker product."""
    rng = np.random.default_rng(5)
    views = [
        replace(v, velocity=rng.normal(size=(400, 2, 2)) @ [1, 1j], std=rng.uniform(1, 3, 400))
        for v in make_views(4, PIXELS)
    ]
    return VolumeVisibility(views, laser, make_plate((6, 5), 4), rule)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", ["absolute", "contravariant"])
def test_cholesky_is_direct(
    make_plate: Make, make_views: Make, laser: TwoMirror, six_points: SampleRule, name: str
) -> None:
    pytest.importorskip("cholespy")
    looks = small(make_plate, make_views, laser, six_points)
    found = [
        solve_field(looks, method_of(name), get("solver", solver)())
        for solver in ("direct", "cholesky")
    ]
    for what in ("velocity", "std", "confidence"):
        direct, cholesky = (getattr(f, what) for f in found)
        size = np.abs(direct).max()
        np.testing.assert_allclose(cholesky, direct, rtol=1e-9, atol=1e-9 * size)


@pytest.mark.whole
def test_cholesky_needs_its_extra(sldvexp: Callable[..., Any], monkeypatch: Any) -> None:
    """Which is told before anything is scanned."""
    monkeypatch.setitem(sys.modules, "cholespy", None)
    done = sldvexp("solver=cholesky")
    assert done.status == 1
    assert done.err == (
        "sldvexp: conf/solver/cholesky.yaml: solver needs the package cholespy: "
        "pip install 'sldvexp[cholesky]', or solver=iterative\n"
    )
    assert not (done.folder / "journal").exists()


def test_looks_without_a_view_are_those_of_the_others(
    make_plate: Make, make_views: Make, laser: TwoMirror, six_points: SampleRule
) -> None:
    looks = small(make_plate, make_views, laser, six_points)
    others = replace(looks, views=[v for v in looks.views if v.name != "2"])
    for triangles in (np.arange(3), np.arange(len(looks.prisms.triangles))):
        looks.at(triangles)
        found, expected = looks.without(1).at(triangles), others.at(triangles)
        np.testing.assert_array_equal(found.directions, expected.directions)
        for a, b in zip(found.by_view, expected.by_view, strict=True):
            assert abs(a.weights - b.weights).max() == 0


def test_looks_over_some_triangles_are_those_of_all(
    make_plate: Make, make_views: Make, laser: TwoMirror, six_points: SampleRule
) -> None:
    looks, some = small(make_plate, make_views, laser, six_points), np.array([0, 2, 5])
    found, expected = looks.at(some), looks._project(some)
    np.testing.assert_array_equal(found.triangles, some)
    for name in ("position", "frame", "valid", "directions"):
        one, other = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14 * np.abs(other).max())
    for a, b in zip(found.by_view, expected.by_view, strict=True):
        assert abs(a.weights - b.weights).max() < 1e-12
        for one, other in zip(a.located, b.located, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


#: A panel imaged from five places, as small as can be.
QUICK = (
    "experiment=curved_panel",
    "scan.pixels=[7,9]",
    "scan.sampling.samples=64",
    "volume.shape=[5,4]",
    "volume.sight.interpolation=linear",
    *("reconstruction=samplewise", "~compare.samplewise", "~check.truth", "~check.samplewise"),
    *("~expect.truth", "~expect.samplewise"),
)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("~pose.views.5", "view 5: has an image but no pose; Valid: 1, 2, 3, 4"),
        ("volume.center=[1.0,0.14,0.0]", "reconstruction: the volume is seen by none of the views"),
        ("signal.flags.reference_minimum=1.0", "lower signal.flags.reference_minimum if it really"),
    ],
)
def test_the_user_of_the_command_sees_the_sentence(
    sldvexp: Callable[..., Any], wrong: str, message: str
) -> None:
    done = sldvexp(*QUICK, wrong)
    assert done.status == 1
    last = done.err.strip().splitlines()[-1]
    assert last.startswith("sldvexp: ")
    assert message in last
    assert "Traceback" not in done.err
