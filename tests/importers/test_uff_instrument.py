"""Whatever the files' conventions, the same velocities come out; what they lack is asked for."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr

from sldvexp.dataset import take_findings
from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import KnownPose, rotation_from_euler
from sldvexp.importers import PointwiseView
from sldvexp.importers import conventions as settings
from sldvexp.importers.uff import UffImport
from sldvexp.laser import Mirror, TwoMirror
from sldvexp.pose import known_poses
from sldvexp.units import LengthUnit

POINTS = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0.01], [0, 0.2, 0]])
FREQUENCY = np.array([10.0, 20.0, 30.0])
ORIGINS = {"a": [0.1, 0.1, 1.5], "b": [1.0, 0.2, 1.0], "c": [0.0, -1.0, 1.2]}
OMEGA = 2 * np.pi * FREQUENCY


@pytest.fixture(scope="module")
def truth():
    rng = np.random.default_rng(3)
    v = 1e-3 * (rng.normal(size=(4, 3, 3)) + 1j * rng.normal(size=(4, 3, 3)))
    directions = {n: np.array(o) - POINTS for n, o in ORIGINS.items()}
    directions = {n: d / np.linalg.norm(d, axis=1, keepdims=True) for n, d in directions.items()}
    return directions, {n: np.einsum("pi,pif->pf", d, v) for n, d in directions.items()}


@pytest.fixture
def write(uff, truth, tmp_path):
    """Write the three views' files in some convention, and the views' settings."""

    def write_(
        convert=lambda v: v,
        before=b"",
        geometry=True,
        after=b"",
        writer=uff.function,
        change=lambda name, content: content,
        length=1.0,
        **more,
    ):
        more = {"type_": 6, "first": 10.0, "step": 10.0, "direction": 0} | more
        views = {}
        for name, v in truth[1].items():
            content = before + (uff.nodes(POINTS / length) if geometry else b"")
            content += b"".join(writer(n, row, **more) for n, row in enumerate(convert(v), 1))
            path = tmp_path / f"{name}.uff"
            path.write_bytes(change(name, content + after))
            views[name] = {"path": str(path), "origin": ORIGINS[name]}
        return views

    return write_


PLAIN = {
    "directions": settings.Directions.view,
    "positive": settings.Positive.towards,
    "phase": settings.Phase.exp_plus,
    "reference": 1.0,
    "length_unit": LengthUnit.m,
}


def read(views, **more):
    views = {n: PointwiseView(**v) for n, v in views.items()}
    return UffImport(views=views, **{**PLAIN, **more}).read()


def refused(views, said, **more):
    with pytest.raises(UserError) as error:
        read(views, **more)
    assert said in str(error.value), str(error.value)
    assert "\n" not in str(error.value)


def right(group, truth, rtol=1e-11):
    np.testing.assert_allclose(group["frequency"], FREQUENCY)
    for name in ORIGINS:
        one = group.sel(view=name)
        np.testing.assert_allclose(one["direction_cosines"], truth[0][name], atol=1e-12)
        np.testing.assert_allclose(one["velocity"], truth[1][name], rtol=rtol)


def test_plain_files(write, truth):
    group = read(write())
    right(group, truth)
    np.testing.assert_allclose(group["position"], POINTS)
    assert group.attrs["import_unit"] == "1 m per unit, by the label m/s"
    assert group.attrs["import_phase"] == "exp_plus"
    assert "velocity_std" not in group


CONVENTIONS = {
    "millimetres by the label": (lambda v: v / 1e-3, {"unit": "mm/s"}, {}),
    "micrometres in another script": (lambda v: v / 1e-6, {"unit": "[µm/s] /V"}, {}),
    "inches as set": (lambda v: v / 0.0254, {"unit": ""}, {"unit": settings.MotionUnit.inch}),
    "displacement": (lambda v: v / (1j * OMEGA), {"quantity": 8, "unit": "m"}, {}),
    "acceleration": (lambda v: v * 1j * OMEGA, {"quantity": 12, "unit": "m/s^2"}, {}),
    "acceleration by its unit": (lambda v: v * 1j * OMEGA, {"quantity": 0, "unit": "(m/s²)/N"}, {}),
    "acceleration in g": (lambda v: v * 1j * OMEGA / 9.80665, {"quantity": 12, "unit": "g"}, {}),
    "quantity as set": (
        lambda v: v / (1j * OMEGA),
        {"quantity": 0, "unit": ""},
        {"quantity": settings.Quantity.displacement, "unit": settings.MotionUnit.m},
    ),
    "other phase": (np.conj, {}, {"phase": settings.Phase.exp_minus}),
    "other phase of displacements": (
        lambda v: np.conj(v / (1j * OMEGA)),
        {"quantity": 8, "unit": "m"},
        {"phase": settings.Phase.exp_minus},
    ),
    "away": (lambda v: -v, {}, {"positive": settings.Positive.away}),
    "reference": (lambda v: v / 2.5, {}, {"reference": 2.5}),
    "rms spectrum": (lambda v: v / 2**0.5, {"kind": 12}, {"amplitude": settings.Amplitude.rms}),
    "half spectrum": (lambda v: v / 2, {"kind": 12}, {"amplitude": settings.Amplitude.half}),
    "peak spectrum": (lambda v: v, {"kind": 12}, {"amplitude": settings.Amplitude.peak}),
}


@pytest.mark.parametrize("name", CONVENTIONS)
def test_conventions(write, truth, name):
    convert, written, settings_ = CONVENTIONS[name]
    right(read(write(convert, **written), **settings_), truth, rtol=1e-10)


def test_units_and_amplitudes_by_data_sets(write, truth, uff):
    before = uff.units(1e-3, "mm") + uff.qualifiers(3)
    views = write(lambda v: v / 1e-3 / 2**0.5, before, kind=12, unit="", length=1e-3)
    group = read(views, length_unit=None)
    right(group, truth)
    np.testing.assert_allclose(group["position"], POINTS)
    assert "1858" in group.attrs["import_amplitude"]


def test_uneven_abscissa_and_binary(write, truth, uff):
    for writer in (uff.function, uff.binary):
        right(read(write(abscissa=FREQUENCY, writer=writer)), truth)


def test_directions_of_dofs_in_local_systems(write, truth, uff):
    far = {n: np.array(o) / np.linalg.norm(o) for n, o in ORIGINS.items()}

    def local(name, content):
        z = far[name]
        x = np.cross([0, 1, 0], z) / np.linalg.norm(np.cross([0, 1, 0], z))
        systems = uff.systems({5: (np.array([x, np.cross(z, x), z]), [0, 0, 0])})
        return systems + content.replace(uff.nodes(POINTS), uff.nodes(POINTS, motion=5))

    views = write(direction=-3, change=local)
    views = {n: {"path": v["path"]} for n, v in views.items()}
    group = read(views, directions=settings.Directions.dof, positive=None)
    for name, direction in far.items():
        np.testing.assert_allclose(
            group.sel(view=name)["direction_cosines"], np.tile(-direction, (4, 1)), atol=1e-15
        )
        np.testing.assert_allclose(group.sel(view=name)["velocity"], truth[1][name], rtol=1e-11)


def test_views_by_the_dofs_of_one_file(uff, tmp_path, truth):
    v = truth[1]["a"]
    sets = [
        uff.function(n, row * k, direction=k, first=10.0, step=10.0)
        for k in (1, 2, 3)
        for n, row in enumerate(v, 1)
    ]
    path = tmp_path / "all.uff"
    path.write_bytes(uff.nodes(POINTS) + b"".join(sets))
    views = {a: {"path": str(path), "dof": f"+{a}"} for a in "XYZ"}
    group = read(views, directions=settings.Directions.dof)
    np.testing.assert_array_equal(group["direction_cosines"][:, 0], np.eye(3))
    np.testing.assert_allclose(group["velocity"][2], 3 * v, rtol=1e-5)
    refused(
        {"all": {"path": str(path)}},
        "are both of node 1 (1+Y and 1+X)",
        directions=settings.Directions.dof,
    )


def poses():
    laser, views = TwoMirror(0.05, up_down=Mirror(80.0), left_right=Mirror(80.0)), {}
    for name, origin in ORIGINS.items():
        euler = [0.0, np.pi, 0.0]
        views[name] = KnownPose(euler=euler, origin=origin)
    return {"pose": known_poses(views, 0.95)}, laser


def test_directions_and_pixels_of_poses(write, truth):
    tree, laser = poses()
    views = {n: PointwiseView(path=v["path"]) for n, v in write().items()}
    own = UffImport(views=views, **{**PLAIN, "directions": settings.Directions.pose, "std": 1e-6})
    group = own.read(tree, laser)
    rotation = rotation_from_euler([0.0, np.pi, 0.0])
    for name in ORIGINS:
        # The beam leaves the second mirror some way before the origin: not quite from there.
        apart = group.sel(view=name)["direction_cosines"].values - truth[0][name]
        assert 1e-6 < np.abs(apart).max() < 0.05
        image = own.images_of_points(tree, laser)[f"image/{name}"]
        beam = -group.sel(view=name)["direction_cosines"].values @ rotation.T
        up_down, left_right = image["angle"].values.T
        np.testing.assert_allclose(beam[:, 0] / np.hypot(*beam[:, 1:].T), np.tan(left_right))
        np.testing.assert_allclose(beam[:, 1] / beam[:, 2], np.tan(up_down), atol=1e-15)
        np.testing.assert_allclose(image["velocity"], truth[1][name], rtol=1e-11)
        assert not image["flags"].any()
    with pytest.raises(UserError, match="needs a pose and a laser"):
        own.read()


def test_response_directions_are_compared_with_those_of_poses(write):
    tree, laser = poses()
    more = {**PLAIN, "directions": settings.Directions.pose, "std": 1e-6}
    for direction, found in ((3, []), (-3, list(ORIGINS)), (2, ["c"])):
        views = {n: PointwiseView(path=v["path"]) for n, v in write(direction=direction).items()}
        images = UffImport(views=views, **more).images_of_points(tree, laser)
        told = take_findings(images)
        assert [f.subject for f in told if f.kind == "sign"] == [f"view {n}" for n in found]
        assert not any("findings" in image.attrs for image in images.values())


def test_views_whose_pose_was_not_found_are_left_out(write):
    tree, laser = poses()
    lost, *others = ORIGINS
    pose = tree["pose"].sel(view=others).assign_attrs(without_pose=json.dumps([lost]))
    views = {n: PointwiseView(path=v["path"]) for n, v in write().items()}
    own = UffImport(views=views, **{**PLAIN, "directions": settings.Directions.pose, "std": 1e-6})
    assert own.read({"pose": pose}, laser)["view"].values.tolist() == others
    assert [*own.images_of_points({"pose": pose}, laser)] == [f"image/{n}" for n in others]
    with pytest.raises(UserError, match=f"view {lost}: has velocities but no pose"):
        own.read({"pose": tree["pose"].sel(view=others)}, laser)


def test_zeros(write, truth):
    def convert(v):
        v = v.copy()
        v[1] = 0
        return v

    views = write(convert)
    refused(views, "data set 3 (58), line 30 and 2 more: all values of 2 are zero")
    group = read(views, zeros=settings.Zeros.missing, incomplete=True)
    assert list(group["point"].values) == ["1", "3", "4"]
    np.testing.assert_allclose(group["position"], POINTS[[0, 2, 3]])
    marked = read(views, zeros=settings.Zeros.missing, incomplete="mark")
    assert list(marked["point"].values) == ["1", "2", "3", "4"]
    np.testing.assert_allclose(marked["position"], POINTS)
    assert np.isnan(marked["velocity"][:, 1]).all()
    np.testing.assert_array_equal(marked["velocity"][:, [0, 2, 3]], group["velocity"])
    assert (marked["flags"].sum(["view", "frequency"]).values > 0).tolist() == [False, True] + [
        False
    ] * 2
    (found,) = take_findings({"line_of_sight": marked})
    assert (found.kind, found.size) == ("missing_points", 1.0)
    refused(views, "has not measured node 2", zeros=settings.Zeros.missing)
    assert (read(views, zeros=settings.Zeros.measured)["velocity"][:, 1] == 0).all()


def test_standard_errors_of_coherence(write, truth, uff):
    coherence = np.array([0.5, 0.9, 1.0])
    after = b"".join(
        uff.function(n, coherence, kind=6, first=10.0, step=10.0, direction=0, quantity=1, unit="")
        for n in range(1, 5)
    )
    views = write(after=after)
    std = read(views, averages=8)["velocity_std"].sel(view="b").values
    expected = np.abs(truth[1]["b"]) * np.sqrt((1 - coherence) / (14 * coherence))
    np.testing.assert_allclose(std, expected, rtol=1e-5, atol=1e-300)
    refused(write(), "has no coherence of node 1", averages=8)
    np.testing.assert_array_equal(read(views, std=2e-6)["velocity_std"], 2e-6)


def test_images_have_their_coherence_and_what_is_behind_them(write, uff):
    square = np.array([0.5, 0.9, 1.0])
    after = b"".join(
        uff.function(n, square, kind=6, first=10.0, step=10.0, direction=0, quantity=1, unit="")
        for n in range(1, 5)
    )
    tree, laser = poses()
    views = {n: PointwiseView(path=v["path"]) for n, v in write(after=after).items()}
    more = {**PLAIN, "directions": settings.Directions.pose, "reference": "2 N"}
    for averages in (8, 0):
        known = {"averages": averages} if averages else {"std": 1e-6}
        image = UffImport(views=views, **more, **known).images_of_points(tree, laser)["image/a"]
        assert image["reference_amplitude"].values.tolist() == [2.0] * 3
        assert image["reference_amplitude"].attrs["units"] == "N"
        assert ("coherence" in image) == ("records" in image) == bool(averages)
        if averages:
            np.testing.assert_allclose(image["coherence"], np.tile(square, (4, 1)), rtol=1e-6)
            assert image["records"].values.tolist() == [8] * 4


def test_chosen_frequencies_and_texts(write, truth, uff):
    group = read(write(), frequency=[30.0, 10.0])
    np.testing.assert_allclose(group["velocity"].sel(view="a"), truth[1]["a"][:, [2, 0]])
    refused(write(), "has no line at 14 Hz; the nearest is 10", frequency=[14.0])
    other = b"".join(
        uff.function(n, np.ones(3) * 1j, first=10.0, step=10.0, words=("H2", "", "", "", ""))
        for n in range(1, 5)
    )
    words = ("Punkt, H1", "", "", "", "")
    refused(write(after=other, words=words), "are both of node 1")
    right(read(write(after=other, words=words), containing="H1"), truth)


ASKED = {
    "phase": ({}, {}),
    "positive": ({}, {}),
    "reference": ({}, {}),
    "amplitude": ({"kind": 12}, {}),
    "quantity": ({"quantity": 0, "unit": ""}, {}),
    "unit": ({"unit": "Einheiten"}, {}),
    "length_unit": ({}, {}),
}


@pytest.mark.parametrize("setting", ASKED)
def test_what_nobody_says_is_asked_for(write, setting):
    written, more = ASKED[setting]
    refused(write(**written), f"say it with instrument.{setting}", **{**more, setting: None})


def test_half_peak_is_asked_about(write, uff):
    views = write(before=uff.qualifiers(1), kind=12)
    refused(views, "data set 1 (1858), line 3 and 2 more: states half-peak")


def without_node(content, uff):
    return content.replace(uff.nodes(POINTS), uff.nodes(POINTS[:3]))


def contradictions(write, uff):
    """Name to (views, what is said, settings)."""
    only_b = lambda old, new: lambda n, c: c.replace(old, new, 1) if n == "b" else c  # noqa: E731
    return {
        "mixed units": (
            {"change": only_b(b"m/s", b"mm/s")},
            "data set 3 (58), line 30: has values in units of 1 m of velocity (by the label m/s)",
            {},
        ),
        "label against 164": (
            {"before": uff.units(1e-3)},
            "units are mixed, say which with instrument.unit",
            {},
        ),
        "quantity against its unit": (
            {"quantity": 12},
            "states the quantity acceleration, but its unit m/s is one of velocity",
            {},
        ),
        "no geometry": ({"geometry": False}, "has no geometry (data set 15 or 2411)", {}),
        "node without position": (
            {"change": lambda n, c: without_node(c, uff)},
            "of view a lacks node 4",
            {},
        ),
        "other positions": (
            {"change": only_b(b"2.9999999999999999D-01", b"3.1000000000000000D-01")},
            "the views must have one geometry",
            {},
        ),
        "no functions": (
            {"change": lambda n, c: uff.nodes(POINTS)},
            "has no functions (data sets 58, 58b) and no values at nodes (55, 2414), but 1",
            {},
        ),
        "only coherences": ({"kind": 6}, "of the type coherence", {}),
        "both types": (
            {"after": uff.function(9, np.ones(3), kind=12)},
            "choose with instrument.function",
            {},
        ),
        "only forces": ({"quantity": 13}, "but none of a displacement, velocity or accel", {}),
        "rotation": ({"direction": 5}, "is of a rotation (1+RY)", {}),
        "no direction": (
            {},
            "node 1 of view a has no direction",
            {"directions": settings.Directions.dof},
        ),
        "other frequencies in a view": (
            {"after": uff.function(9, np.ones(3) + 1j, first=11.0)},
            "has other frequencies than",
            {},
        ),
        "fewer points in a view": (
            {
                "change": lambda n, c: (
                    c + uff.function(9, np.ones(3) + 1j, first=10.0, step=10.0) if n == "c" else c
                )
            },
            "has not measured node 9",
            {},
        ),
        "negative frequencies": ({"first": -10.0}, "has a negative frequency", {}),
    }


CONTRADICTIONS = (
    "mixed units",
    "label against 164",
    "quantity against its unit",
    "no geometry",
    "node without position",
    "other positions",
    "no functions",
    "only coherences",
    "both types",
    "only forces",
    "rotation",
    "no direction",
    "other frequencies in a view",
    "fewer points in a view",
    "negative frequencies",
)


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_contradictions(write, uff, name):
    written, said, more = contradictions(write, uff)[name]
    views = write(**written)
    if more:
        views = {n: {"path": v["path"]} for n, v in views.items()}
    refused(views, said, **more)


def test_other_frequencies_in_another_view(write):
    views = write(
        change=lambda n, c: (
            c.replace(b" 1.00000E+01  1.00000E+01", b" 2.00000E+01  1.00000E+01") if n == "b" else c
        )
    )
    refused(views, "view b has other frequencies than view a")


def test_settings_that_cannot_be():
    for wrong in (
        {"views": {}},
        {"views": {"a": PointwiseView(path="x", origin=[1.0, 2.0])}},
        {"views": {"a": PointwiseView(path="x", dof="Z")}},
        {"views": {"a": PointwiseView(path="x", direction=[0.0, 0.0, 0.0])}},
        {"views": {"a": PointwiseView(path="x")}, "directions": settings.Directions.view},
        {"views": {"a": PointwiseView(path="x", origin=[1.0, 2.0, 3.0])}},
        {"views": {"a": PointwiseView(path="x")}, "std": 0.0},
        {"views": {"a": PointwiseView(path="x")}, "std": 1e-6, "averages": 3},
        {"views": {"a": PointwiseView(path="x")}, "averages": 1},
        {"views": {"a": PointwiseView(path="x")}, "noise_ratio": 2.0},
        {"views": {"a": PointwiseView(path="x")}, "frequency": [-1.0]},
    ):
        with pytest.raises(ConfigError):
            UffImport(**wrong)


def test_group_is_the_dataset_of_the_program(write):
    group = read(write())
    assert isinstance(group, xr.Dataset)
    assert group["velocity"].dims == ("view", "point", "frequency")


@pytest.fixture
def records(uff, truth, tmp_path):
    """Files of time records, with that of the reference at node 99 in front."""

    def write_(noise=0.0, turn=0.0, reference=1, **more):
        rng = np.random.default_rng(8)
        t = 0.0123 + np.arange(400) / 1000
        waves = np.exp(1j * np.outer(OMEGA, t) + 1j * turn)
        more = {"first": t[0], "step": 1e-3, "type_": 4, "kind": 1, "direction": 0} | more
        views = {}
        for name, v in truth[1].items():
            content = uff.nodes(POINTS)
            for _ in range(reference):
                more_ = more | {"direction": 3, "quantity": 13, "unit": "N"}
                content += uff.function(99, 5 * waves.sum(axis=0).real, **more_)
            for n, row in enumerate(v, 1):
                y = (row @ waves).real + noise * rng.normal(size=len(t))
                content += uff.function(n, y + 1e-4, **more)
            path = tmp_path / f"{name}.uff"
            path.write_bytes(content)
            views[name] = {"path": str(path), "origin": ORIGINS[name]}
        return views

    return write_


TIME = {"frequency": list(FREQUENCY), "time_reference": "99+Z", "phase": None, "reference": None}


def test_time_records(records, truth):
    right(read(records(turn=0.7), **TIME), truth, rtol=1e-7)
    right(read(records(), **TIME | {"time_reference": "trigger"}), truth, rtol=1e-7)
    right(read(records(reference=0), **TIME | {"time_reference": "trigger"}), truth, rtol=1e-7)
    quantity = {"quantity": settings.Quantity.displacement}
    group = read(records(turn=0.7), **TIME, **quantity)
    expected = truth[1]["a"] * 1j * OMEGA
    np.testing.assert_allclose(group["velocity"].sel(view="a"), expected, rtol=1e-7)


def test_errors_of_time_records(records, truth):
    noise = 2e-4
    group = read(records(noise=noise, turn=0.7), **TIME)
    np.testing.assert_allclose(group["velocity_std"], noise * np.sqrt(2 / 400), rtol=0.2)
    error = group["velocity"] - np.stack([truth[1][n] for n in ORIGINS])
    part = np.concatenate([error.real, error.imag]) / noise / np.sqrt(2 / 400)
    assert abs(part.std() - 1) < 4 / np.sqrt(2 * part.size)


def test_time_records_that_are_refused(records, write, uff):
    refused(records(), "say it with instrument.time_reference", **TIME | {"time_reference": ""})
    refused(records(), "say it with instrument.frequency", **TIME | {"frequency": []})
    refused(records(reference=0), "has 0 time records of 99+Z", **TIME)
    refused(records(reference=2), "has 2 time records of 99+Z", **TIME)
    several = TIME | {"frequency": [10.0, 10.1]}
    refused(records(noise=1e-3), "the reference has no clear sine of 10.1 Hz", **several)
    short = TIME | {"frequency": list(np.linspace(1, 99, 250))}
    refused(records(), "must be a real record of more than 501 values", **short)
