"""Figures show what the dataset holds, with units, bounds, and all of their labels."""

from __future__ import annotations

import itertools
import re

import matplotlib
import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from omegaconf import OmegaConf

import sldvexp.plot
from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.image import fit_circle, pinhole_edges
from sldvexp.laser import TwoMirror
from sldvexp.plot import FIGURES, figures_of, shape, style
from sldvexp.plot.paper import SETTINGS
from sldvexp.plot.style import prefixed
from sldvexp.session.circles import edges_of

SHOWN = (
    *("scan_lines", "edges", "conics", "conic_residuals", "bitangents", "pose_residuals"),
    *("phase_correction", "images", "volume", "field", "surface", "nodal"),
    *("strain", "hot_spots", "residuals"),
)

#: What an axis may be called: a quantity with its unit, or what is counted.
UNIT = re.compile(
    r"((, (mm|m|deg|rad|Hz|[nµmk]?m/s)| DAC steps|per step)( |\(|$))|^[nµm]?(m/s|strain)$|^[kM]?Pa$"
)
#: Names of rows of images, and what is counted.
COUNTED = {
    "raw",
    "corrected",
    "view 1",
    "view 2",
    "view 3",
    "view",
    "circle",
    "point",
    "component",
    "node",
    "reconstruction",
    "seed",
}


def bars(axes):
    """Half-lengths of the error bars of every container of a panel, largest side."""
    found = []
    for container in axes.containers:
        if hasattr(container, "lines") and container.lines[2]:
            segments = container.lines[2][0].get_segments()
            found.append(np.array([np.ptp(np.asarray(s)[:, 1]) / 2 for s in segments]))
    return found


@pytest.mark.whole
def test_the_session_shows_its_figures(tree):
    assert tuple(figures_of(tree)) == SHOWN


def test_groups_without_a_folder_have_no_scan_lines(tree, run_file):
    groups = {n.path.strip("/"): n.to_dataset() for n in tree.subtree if n.has_data}
    assert set(figures_of(groups)) == set(SHOWN) - {"scan_lines"}
    assert "field" in figures_of(run_file)


@pytest.mark.one_in(5)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=[pytest.mark.long] * (n == "scan_lines"))
        for n in sorted(SHOWN, reverse=True)
    ],
)
def test_labels_are_inside_and_apart(figures, name):
    figure = figures[name]
    with matplotlib.rc_context(SETTINGS):  # as it is saved
        labels_are_inside_and_apart(figure)


def labels_are_inside_and_apart(figure):
    box = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert min(box.x0, box.y0) >= -0.01
    assert max(box.x1 - width, box.y1 - height) <= 0.01
    panels = [a.get_tightbbox() for a in figure.axes]
    panels += [legend.get_window_extent() for legend in figure.legends]
    panels += [figure._suptitle.get_window_extent()]
    for one, other in itertools.combinations(panels, 2):
        shared = one.intersection(one, other)
        assert shared is None or shared.width < 2 or shared.height < 2
    for axes in figure.axes:
        low, high = sorted(axes.get_xlim())
        ticks = [t for t in axes.get_xticklabels() if t.get_text() and t.get_visible()]
        ticks = [t for t in ticks if low <= t.get_position()[0] <= high]
        extents = sorted((t.get_window_extent().extents[[0, 2]] for t in ticks), key=min)
        if axes.name != "3d":
            assert all(a[1] < b[0] for a, b in itertools.pairwise(extents))


def test_numbers_of_scales_begin_where_the_scales_do():
    figure = Figure(figsize=(3.0, 2.0))
    for at, high in enumerate((0.034, 34.0)):
        axes = figure.add_axes((0.1 + 0.4 * at, 0.5, 0.35, 0.4))
        style.scale_below(axes, axes.imshow([[0.0, high]]), "mm/s")
    figure.draw_without_rendering()
    for scale in figure.axes[1::2]:
        first, *_ = (t for t in scale.get_xticklabels() if t.get_text())
        assert first.get_window_extent().x0 >= scale.get_window_extent().x0 - 1


def test_no_moment_is_less_than_nothing():
    velocity = np.array([1.0 + 1e-9j, 0.5])
    assert shape.at_largest(velocity, velocity)[0] == "ωt = +0°"


def test_names_beside_a_place_are_as_far_from_it_as_spaces_say():
    pose = {"origin": np.zeros((1, 3)), "rotation": [np.eye(3)]}
    figure = sldvexp.plot.stands({"pose": dataset.group("pose", {"view": ["front"]}, **pose)})
    names = [t.get_text() for t in figure.axes[0].texts]
    assert [name.rstrip(" ") for name in names] == names  # which SVG would leave out
    assert names[0].rstrip() == "front"


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", SHOWN)
def test_every_axis_has_its_unit_and_every_panel_its_data(figures, name):
    figure = figures.made(name)
    assert figure.axes
    for axes in figure.axes:
        labels = [axes.get_xlabel(), axes.get_ylabel()]
        labels += [axes.get_zlabel()] if axes.name == "3d" else []
        scale = axes.get_label() == "<colorbar>"
        assert any(labels) or not scale
        for label in filter(None, labels):
            assert UNIT.search(label) or label in COUNTED, label
        assert axes.has_data() or scale
    outer = figure.axes[0]
    assert outer.get_ylabel()


@pytest.mark.parametrize("name", FIGURES)
def test_what_is_missing_is_said_in_one_sentence(name):
    with pytest.raises(UserError, match=f"plot: {name}: .*(no|not) ") as raised:
        getattr(sldvexp.plot, name)({})
    assert "\n" not in str(raised.value)
    assert figures_of({}) == {}


def test_numbers_stand_at_the_left_of_images_only(figures):
    axes = [a for a in figures["images"].axes if a.get_label() != "<colorbar>"]
    told = [a.yaxis.get_tick_params()["labelleft"] for a in axes]
    assert told == [n % 4 == 0 for n in range(len(axes))]


def test_images_are_of_the_pixels(figures, tree):
    for row, view in zip(np.reshape(figures["images"].axes[:12], (3, 4)), "123", strict=True):
        group = tree[f"image/{view}"].to_dataset().isel(frequency=0)
        good = group["flags"].values == 0
        for axes, take in zip(row, (np.real, np.imag, np.abs, np.angle), strict=True):
            drawn = axes.images[0].get_array().ravel()
            factor = np.degrees(1.0) if take is np.angle else 1000.0
            values = take(group["velocity"].values) * factor
            shown = good
            if take is np.angle:
                shown = good & (abs(group["velocity"].values) > 3 * group["velocity_std"].values)
            np.testing.assert_allclose(drawn[shown], values[shown], rtol=1e-12)
            assert np.ma.getmaskarray(drawn)[~shown].all()


def test_pixels_are_where_the_mirrors_were(figures, tree):
    dac = tree["image/1/dac"].values.reshape(9, 11, 2)
    left, right, low, high = figures["images"].axes[0].images[0].get_extent()
    wide, tall = (right - left) / 11, (high - low) / 9
    np.testing.assert_allclose(left + (np.arange(11) + 0.5) * wide, dac[0, :, 1], atol=1)
    np.testing.assert_allclose(low + (np.arange(9) + 0.5) * tall, dac[:, 0, 0], atol=1)


def test_pixels_of_an_uneven_grid_are_where_they_are(tree):
    group = tree["image/1"].to_dataset().isel(frequency=0, drop=True).copy(deep=True)
    group["dac"].loc[{"mirror": "left_right"}] += (group["pixel"].values % 11 == 3) * 20
    mesh = sldvexp.plot.images({"image/1": group}).axes[0].collections[0]
    middles = mesh.get_coordinates()[:-1, :-1] / 2 + mesh.get_coordinates()[1:, 1:] / 2
    dac = group["dac"].values.reshape(9, 11, 2)
    np.testing.assert_allclose(middles[:, 5:-1], dac[:, 5:-1, ::-1], atol=1)
    assert not np.allclose(middles[:, 3, 0], dac[:, 2:5:2, 1].mean(axis=1), atol=2)


def test_the_name_of_a_common_axis_is_below_its_numbers(figures):
    """That of left-right lies below the last view, whose numbers it must leave free."""
    figure = figures["images"]
    (name,) = (t for t in figure.texts if t.get_text().startswith("left-right"))
    with matplotlib.rc_context(SETTINGS):  # as it is saved: ticks are made when asked for
        top = name.get_window_extent().y1
        for axes in figure.axes[8:12]:
            numbers = [t.get_window_extent() for t in axes.get_xticklabels() if t.get_text()]
            assert min(box.y0 for box in numbers) - top > 1.0


AS_SEEN = ("images", "phase_correction", "edges", "conics", "bitangents", "volume")


def rightwards(axes, steps):
    """How far to the right and up, pixels, a panel has places of (left-right, up-down)."""
    places = axes.transData.transform(steps)
    return places - places[0]


@pytest.mark.whole
@pytest.mark.parametrize("name", AS_SEEN)
def test_views_are_as_one_sees_them_at_the_instrument(figures, name):
    panels = [a for a in figures[name].axes if a.get_aspect() != "auto" and a.name != "3d"]
    assert panels
    for axes in panels:  # the mirrors' angles, and their steps, grow to the left and upwards
        _, more_left, higher = rightwards(axes, [(0, 0), (1, 0), (0, 1)])
        assert more_left[0] < 0 < higher[1]


def test_mirrors_that_turn_the_other_way_leave_what_is_seen(tree, figures):
    """The same object by mirrors of negative gains: other steps, the same picture."""
    groups = {n.path.strip("/"): n.to_dataset().copy(deep=True) for n in tree.subtree if n.has_data}
    config = OmegaConf.create(str(tree.attrs["config"]))
    for mirror in ("up_down", "left_right"):
        config.laser[mirror].gain *= -1
    edge = groups["edge/1"]
    edge["dac"] = -edge["dac"]
    attributes = {**tree.attrs, "config": OmegaConf.to_yaml(config)}
    turned = xr.DataTree.from_dict({**groups, "/": xr.Dataset(attrs=attributes)})
    own, other = figures["edges"], sldvexp.plot.edges(turned)
    other.draw_without_rendering()
    seen = [
        rightwards(f.axes[0], np.concatenate([line.get_xydata() for line in f.axes[0].get_lines()]))
        for f in (own, other)
    ]
    np.testing.assert_allclose(seen[1], seen[0], atol=1.0)


def test_circles_have_the_numbers_of_the_calibration_object(tree):
    """A session whose rough centres were given in another order is told of by the same numbers."""
    groups = {n.path.strip("/"): n.to_dataset().copy(deep=True) for n in tree.subtree if n.has_data}
    whole = {**groups, "/": xr.Dataset(attrs=tree.attrs)}
    wanted = sldvexp.plot.edges(xr.DataTree.from_dict(whole), view="1").axes[0].get_lines()
    order = {1: 3, 2: 1, 3: 4, 4: 2}
    edge = groups["edge/1"]
    edge["circle"][:] = [order[int(k)] for k in edge["circle"].values]
    pose = groups["pose"]
    pose["rough_centre"].loc[{"view": "1"}] = [
        order[int(k)] for k in pose["rough_centre"].sel(view="1").values
    ]
    shuffled = xr.DataTree.from_dict({**groups, "/": xr.Dataset(attrs=tree.attrs)})
    found = sldvexp.plot.edges(shuffled, view="1").axes[0].get_lines()
    for own, other in zip(wanted, found, strict=True):
        assert own.get_label() == other.get_label()
        np.testing.assert_array_equal(own.get_xydata(), other.get_xydata())


@pytest.mark.one_in(2)
@pytest.mark.parametrize("far", [(-1510.0, 10.0), (-32000.0, 32000.0)])
def test_labels_of_images_are_apart_wherever_the_pixels_are(tree, far):
    group = tree["image/1"].to_dataset().isel(frequency=0, drop=True).copy(deep=True)
    for steps in group["dac"].values.T:
        steps[:] = np.interp(steps, (steps.min(), steps.max()), far)
    figure = sldvexp.plot.images({"image/1": group})
    with matplotlib.rc_context(SETTINGS):
        figure.draw_without_rendering()
        labels_are_inside_and_apart(figure)


def test_phase_correction_has_both_stages(figures, tree):
    group = tree["image/1"].to_dataset().isel(frequency=0)
    good = group["flags"].values == 0
    stages = {"raw": "uncorrected", "corrected": "velocity"}
    figure = figures["phase_correction"]
    assert [axes.get_title() for axes in figure.axes[:4]][3] == "phase"
    for axes, first, (told, name) in zip(
        figure.axes[3:8:4], figure.axes[0:8:4], stages.items(), strict=True
    ):
        drawn = axes.images[0].get_array().ravel()
        shown = good & (abs(group[name].values) > 3 * group["velocity_std"].values)
        phases = np.degrees(np.angle(group[name].values))
        np.testing.assert_allclose(drawn[shown], phases[shown])
        assert first.get_ylabel() == told


def test_pixels_of_a_list_are_dots(tree):
    group = tree["image/2"].to_dataset().isel(frequency=0, drop=True)
    group.attrs = {}
    figure = sldvexp.plot.images({"image/2": group})
    good = group["flags"].values == 0
    dots = figure.axes[2].collections[0]
    np.testing.assert_array_equal(dots.get_offsets(), group["dac"].values[good][:, ::-1])
    np.testing.assert_allclose(dots.get_array(), 1000 * np.abs(group["velocity"].values[good]))


def test_what_no_view_determines_is_said(tree):
    groups = {n.path.strip("/"): n.to_dataset() for n in tree.subtree if n.has_data}
    field = groups["field"].copy(deep=True)
    field["velocity"].loc[{"component": "y"}] = complex(np.nan, np.nan)
    field["observable"].loc[{"component": "y"}] = 0
    groups["field"] = field
    for name, panels in (("field", [3, 5]), ("nodal", [2, 3])):
        figure = getattr(sldvexp.plot, name)(groups)
        told = [k for k, a in enumerate(figure.axes) if a.texts]
        assert told == panels
        assert figure.axes[panels[0]].texts[0].get_text() == "not determined"


def test_scan_lines_end_at_the_edges_of_the_run(figures, tree):
    raw, median, gradient, found = figures["scan_lines"].axes[1::2]
    assert len(raw.get_lines()[:16]) == 16
    place = raw.lines[0].get_xdata()
    steps = median.lines[0].get_ydata()
    np.testing.assert_allclose(
        gradient.lines[0].get_ydata(), np.gradient(steps) / np.ptp(place) * (len(place) - 1)
    )
    group = tree["edge/1"].to_dataset()
    own = group["circle"].values == 1
    (container,) = found.containers
    errors = [np.ptp(np.asarray(s)[:, 0]) / 2 for s in container.lines[2][0].get_segments()]
    np.testing.assert_allclose(errors, group["dac_std"].values[own], rtol=1e-9)
    assert f"{own.sum()} edges ± standard error" in found.get_title()


def test_edges_are_those_of_every_view(figures, tree):
    for axes, view in zip(figures["edges"].axes, "123", strict=True):
        drawn = np.concatenate([line.get_xydata() for line in axes.get_lines()])
        np.testing.assert_array_equal(drawn, tree[f"edge/{view}/dac"].values[:, ::-1])


def test_conics_have_their_residuals_and_errors(figures, tree):
    edges = edges_of(tree["edge/1"].to_dataset())
    lower = figures["conics"].axes[4:]
    for axes, edge in zip(lower, edges, strict=True):
        fit, _ = fit_circle(pinhole_edges(TwoMirror(), edge))
        (container,) = axes.containers
        np.testing.assert_allclose(container.lines[0].get_ydata(), fit.residual, atol=1e-9)
        np.testing.assert_allclose(bars(axes)[0], fit.residual_std, rtol=1e-6)


def test_bitangent_points_are_those_of_the_registration(figures, tree):
    for axes, dac in zip(figures["bitangents"].axes, tree["registration/dac"].values, strict=True):
        points = axes.get_lines()[-1]
        np.testing.assert_array_equal(points.get_xydata(), dac[:, ::-1])
        assert [t.get_text() for t in axes.texts] == [str(n) for n in range(1, 17)]
        ellipses = [line for line in axes.get_lines() if line.get_label() == "ellipse"]
        for point in dac:
            nearest = min(
                np.linalg.norm(e.get_xydata()[:, ::-1] - point, axis=1).min() for e in ellipses
            )
            assert nearest < 2.5  # steps; the curve has a point every 2 deg


@pytest.mark.whole
def test_distances_of_all_edges_stand_beside_their_circle(figures, tree):
    for axes, view in zip(figures["conic_residuals"].axes, "123", strict=True):
        edges = edges_of(tree[f"edge/{view}"].to_dataset())
        assert [t.get_text() for t in axes.get_xticklabels()] == ["1", "2", "3", "4"]
        fits = [fit_circle(pinhole_edges(TwoMirror(), edge))[0] for edge in edges]
        square, dof = sum(f.chi_square for f in fits), sum(f.dof for f in fits)
        assert f"χ² {square:.0f} of {dof} degrees" in axes.get_title()
        for number, (container, fit) in enumerate(zip(axes.containers, fits, strict=True), 1):
            x, y = container.lines[0].get_data()
            assert (abs(x - number) <= 0.4).all()
            np.testing.assert_allclose(y, fit.residual, atol=1e-9)


@pytest.mark.whole
def test_one_view_is_enough(tree):
    for name in ("edges", "bitangents", "images"):
        figure = getattr(sldvexp.plot, name)(tree, view="2")
        panel = figure.axes[0]
        assert "view 2" in (panel.get_title() or "") + panel.get_ylabel(), name
        with matplotlib.rc_context(SETTINGS):
            figure.draw_without_rendering()
            labels_are_inside_and_apart(figure)


def test_pose_residuals_have_s_as_their_error(figures, tree):
    pose = tree["pose"].to_dataset()
    for axes, view in zip(figures["pose_residuals"].axes, "123", strict=True):
        one = pose.sel(view=view)
        for container, half, mirror in zip(
            axes.containers, bars(axes), ("left_right", "up_down"), strict=True
        ):
            drawn = container.lines[0].get_ydata()
            np.testing.assert_array_equal(drawn, one["residual"].sel(mirror=mirror).values)
            np.testing.assert_allclose(half, float(one["s"]))


def test_the_volume_is_seen_where_the_pixels_are(figures, tree):
    panels = [a for a in figures["volume"].axes if a.name != "3d"]
    for axes, view in zip(panels, "123", strict=True):
        pixels, nodes = axes.get_lines()[:2]
        angle = np.degrees(tree[f"image/{view}/angle"].values[:, ::-1])
        np.testing.assert_array_equal(pixels.get_xydata(), angle)
        assert len(nodes.get_xdata()) == 42
        assert (nodes.get_xydata().min(axis=0) > angle.min(axis=0)).all()
        assert (nodes.get_xydata().max(axis=0) < angle.max(axis=0)).all()
    scene = next(a for a in figures["volume"].axes if a.name == "3d")
    assert [t.get_text().strip() for t in scene.texts] == ["1", "2", "3"]


def test_field_maps_are_of_the_surface_layer(figures, tree):
    field = tree["field"].to_dataset().isel(frequency=0, node=slice(42, 84))
    panels = np.reshape(figures["field"].axes[:9], (3, 3))
    factor, unit = prefixed(np.abs(field["velocity"]), "m/s")
    scales = [a.get_xlabel() for a in figures["field"].axes[9:]]
    assert scales == [unit, "phase, deg", unit]  # one for each column, of all components
    for (size, _, bound), component in zip(panels, "xyz", strict=True):
        own = field.sel(component=component)
        for axes, values in ((size, np.abs(own["velocity"])), (bound, own["confidence"])):
            np.testing.assert_allclose(axes.collections[0].get_array(), factor * values)
        largest = factor * np.abs(field["velocity"].values).max()
        assert size.collections[0].get_clim() == pytest.approx((0.0, largest))
        assert "95% bound" in bound.get_title()
    phase = panels[2, 1].collections[-1].get_array()
    z = field.sel(component="z")
    three = tree["field/element"].values[:, :3]
    mean = z["velocity"].values[three[(three < 42).all(axis=1)]].mean(axis=1)
    np.testing.assert_allclose(phase, np.degrees(np.angle(mean)))


def test_nodal_values_have_their_bounds(figures, tree):
    field = tree["field"].to_dataset().isel(frequency=0)
    panels = np.reshape(figures["nodal"].axes, (3, 2))
    position = 1000 * field["position"].values[42:84]
    for row, component in zip(panels, "xyz", strict=True):
        own = field.sel(component=component)
        for axes, part, take in zip(row, ("real", "imaginary"), (np.real, np.imag), strict=True):
            x, y = axes.containers[0].lines[0].get_data()
            assert len(x) == 7
            row_of_nodes = 42 + np.flatnonzero(np.isin(np.round(position[:, 0], 6), np.round(x, 6)))
            values = take(own["velocity"].values[row_of_nodes])
            scale = 1000.0
            assert row[0].get_ylabel() == f"{component}, mm/s"
            assert axes.get_title() == f"{component}: {part} part"
            assert np.isin(np.round(y, 6), np.round(scale * values, 6)).all()
            half = bars(axes)[0]
            bound = scale * own["confidence_by_part"].sel(part=part).values[row_of_nodes]
            assert np.isin(np.round(half, 5), np.round(bound, 5)).all()
        named = row[0].get_legend_handles_labels()[1]
        assert any("truth" in name for name in named) == (component == "z")


def test_nodal_values_of_chosen_nodes(tree):
    figure = sldvexp.plot.nodal(tree, nodes=[50, 44], component="z")
    x, y = figure.axes[0].containers[0].lines[0].get_data()
    velocity = tree["field/velocity"].sel(component="z").values[[44, 50], 0]
    np.testing.assert_array_equal(x, [44, 50])
    np.testing.assert_allclose(y, 1000 * velocity.real)
    with pytest.raises(UserError, match="nodes at the surface have the numbers 42 to 83"):
        sldvexp.plot.nodal(tree, nodes=[7])


def test_surface_is_the_moment_of_the_largest_velocity(figures, tree):
    axes, scale = figures["surface"].axes
    assert axes.get_zlabel() == "z, mm"
    assert scale.get_ylabel() == "velocity along z, mm/s"
    field = tree["field"].to_dataset().isel(node=slice(42, 84), frequency=0)
    z = field["velocity"].sel(component="z").values
    phase = np.angle(z[np.abs(z).argmax()])
    assert f"ωt = {round(-np.degrees(phase)):+d}°" in figures["surface"].get_suptitle()
    now = 1000 * np.real(z * np.exp(-1j * phase))
    np.testing.assert_allclose(scale.get_ylim(), (-np.abs(now).max(), np.abs(now).max()))
    surface, _ = axes.collections
    drawn = np.asarray(surface._faces).reshape(-1, 3)  # corners of triangles
    rest = 1000 * field["position"].values
    assert len(drawn) >= 2 * len(rest)
    # on the true shape: only z is moved, and by the same factor everywhere
    factor = 0.12 * np.linalg.norm(np.ptp(rest, axis=0)) / np.abs(now).max()
    expected = rest + factor * now[:, None] * [0, 0, 1]
    assert {tuple(p) for p in drawn.round(6)} == {tuple(p) for p in expected.round(6)}
    # and with equal scales: a millimetre is as long along x as along z
    box = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    aspect = np.asarray(axes.get_box_aspect() if hasattr(axes, "get_box_aspect") else 1)
    shares = np.asarray(axes._box_aspect) / np.ptp(box, axis=1)
    assert aspect is not None
    np.testing.assert_allclose(shares, shares[0])


@pytest.mark.whole
def test_noise_is_pale_and_not_drawn_at_full_height(tree):
    groups = {n.path.strip("/"): n.to_dataset() for n in tree.subtree if n.has_data}
    noise = groups["field"].copy(deep=True)
    rng = np.random.default_rng(1)
    noise["velocity"].values[:] = rng.normal(size=(*noise["velocity"].shape, 2)) @ [1e-6, 1e-6j]
    for name in ("confidence", "confidence_by_part"):
        noise[name].values[:] = 1e-5
    groups["field"] = noise
    figure = sldvexp.plot.surface(groups, component="z")
    assert "pale: below its bound" in figure.get_suptitle()
    surface, _ = figure.axes[0].collections
    z, rest = np.asarray(surface._faces)[..., 2], 1000 * noise["position"].values[42:84]
    full = 0.12 * np.linalg.norm(np.ptp(rest, axis=0))
    largest = np.abs(noise["velocity"].sel(component="z").values[42:84]).max()
    assert np.ptp(z) <= 2 * full * largest / 1e-5 * 1.001
    assert (surface.get_facecolor()[:, :3] > 0.7).all()
    size = sldvexp.plot.field(groups).axes[0]
    pale = size.collections[0].veiled
    assert pale.all()
    assert len(pale) == len(surface.get_facecolor())


def test_a_panel_that_bends_is_rolled_out():
    from sldvexp.volume import Grid

    volume = Grid(size=[0.3, 0.2], shape=[13, 9], layers=3, thickness=0.01, radius=0.2).group()
    velocity = volume["position"].values + 0j
    solved = dataset.group(
        "field",
        {},
        velocity=velocity,
        position=volume["position"].values,
        element=volume["element"].values,
        confidence=np.full(velocity.shape, 1e-3),
        observable=np.ones(velocity.shape, int),
    )
    figure = sldvexp.plot.field({"volume": volume, "field": solved})
    figure.draw_without_rendering()
    panel = figure.axes[6]
    assert {panel.get_xlabel(), panel.get_ylabel()} == {"arc, mm", "y, mm"}
    assert np.ptp(panel.get_xlim()) == pytest.approx(300, rel=1e-3)
    assert np.ptp(panel.get_ylim()) == pytest.approx(200, rel=1e-9)
    assert panel.get_window_extent().width / panel.get_window_extent().height == pytest.approx(
        1.5, rel=0.01
    )


FIELDS = ("field", "compare/samplewise")


def test_residuals_are_those_by_view(figures, tree):
    (axes,) = figures["residuals"].axes
    heights = [bar.get_height() for bar in axes.patches]
    shown = [tree[f"{of}/residual_std_by_view"].values[:, 0] for of in FIELDS]
    _, unit = prefixed(np.concatenate(shown), "m/s")
    assert axes.get_ylabel() == f"r.m.s. residual, {unit}"
    ratio = heights / np.concatenate(shown)
    np.testing.assert_allclose(ratio, prefixed(heights[0] / ratio[0], "m/s")[0])
    assert [t.get_text() for t in axes.get_xticklabels()] == ["1", "2", "3"]


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("images", {"view": "9"}, "there is no view 9.*Valid: 1, 2, 3"),
        ("conics", {"view": "9"}, "there is no view 9"),
        ("scan_lines", {"circle": 5}, "there is no circle 5"),
        ("field", {"frequency": 500.0}, "frequencies go from 197 to 197 Hz"),
        ("field", {"depth": 0.5}, "layers lie from -12 to 12 mm"),
        ("surface", {"component": "t1"}, "no component t1, only x, y, z"),
        ("nodal", {"name": "other"}, "there is no field other"),
        ("nodal", {"nodes": "some"}, "line, all or numbers"),
    ],
)
def test_a_wrong_choice_is_named(tree, name, options, said):
    with pytest.raises(UserError, match=said):
        getattr(sldvexp.plot, name)(tree, **options)


@pytest.mark.whole
def test_a_run_at_a_prompt_is_short_and_its_file_is_opened_once(run_file, monkeypatch):
    opened, load = [], dataset.load
    monkeypatch.setattr(dataset, "load", lambda path: opened.append(path) or load(path))
    known = figures_of(run_file)
    assert len(repr(known["field"])) < 300
    for _ in range(3):
        sldvexp.plot.residuals(str(run_file))
    assert len(opened) <= 1


def test_a_truth_of_some_components_says_so(tree):
    own = sldvexp.plot.nodal(tree)
    (told,) = (t.get_text() for t in own.legends[0].get_texts() if "truth" in t.get_text())
    assert told == "truth (z only: x and y change through the thickness)"


def test_few_pixels_are_wider_than_the_nodes_on_them(figures):
    panel = next(axes for axes in figures["volume"].axes if axes.get_title() == "view 1")
    size = {line.get_label(): line.get_markersize() for line in panel.lines}
    assert size["pixel"] > size["node of the surface"]
