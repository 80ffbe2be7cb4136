"""Figures of points, repeats and sweeps; files of figures; the command."""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
from pathlib import Path

import matplotlib
import numpy as np
import pytest
import xarray as xr
from omegaconf import OmegaConf

import sldvexp.plot
from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.plot.style import COLOURS, SIGN_MAP, looks, prefixed

_spec = importlib.util.spec_from_file_location(
    "groups_of_runs", Path(__file__).with_name("groups_of_runs.py")
)
groups = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(groups)


def half_lengths(container):
    segments = container.lines[2][0].get_segments()
    return [np.ptp(np.asarray(s)[:, 1]) / 2 for s in segments if len(s)]


def test_points_have_their_bounds():
    tree = {"point": groups.point(1), "compare/other": groups.point(2)}
    figure = sldvexp.plot.point(tree)
    for k, row in enumerate(np.reshape(figure.axes, (2, 2))):
        for axes, take in zip(row, (np.real, np.imag), strict=True):
            for container, group in zip(axes.containers, tree.values(), strict=True):
                values = group["velocity"].values[:, k]
                np.testing.assert_allclose(container.lines[0].get_ydata(), 1000 * take(values))
                bound = 1000 * group["confidence"].values[:, k]
                np.testing.assert_allclose(half_lengths(container), bound)
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["point", "other"]


def test_names_are_written_as_they_are(tmp_path):
    tree = {"point": groups.point(1, 1), r"compare/a$\nonsense_$": groups.point(2, 1)}
    (file,) = sldvexp.plot.save(sldvexp.plot.point(tree), tmp_path / "point", formats=["svg"])
    assert r">a$\nonsense_$<" in file.read_text(encoding="utf-8")


def test_what_is_not_determined_is_no_dot_in_either_part():
    own = groups.point(1)
    own["velocity"].values[1:] = np.nan  # and an imaginary part of 0
    for axes in sldvexp.plot.point({"point": own}).axes:
        (drawn,) = [c.lines[0].get_ydata() for c in axes.containers]
        assert np.isfinite(drawn).tolist() == [True, False, False]


def test_many_frequencies_are_a_spectrum():
    group = groups.point(1, 40)
    figure = sldvexp.plot.point({"point": group})
    left = figure.axes[0::2]
    for axes, component in zip(left, "xyz", strict=True):
        x, y = axes.lines[0].get_data()
        np.testing.assert_array_equal(x, group["frequency"].values)
        values = group["velocity"].sel(component=component).values
        np.testing.assert_allclose(y, 1000 * np.abs(values))
        top = axes.collections[0].get_paths()[0].vertices[:, 1].max()
        bound = group["confidence"].sel(component=component).values
        assert top == pytest.approx(1000 * (np.abs(values) + bound).max())
    z = group.sel(component="z")
    (phases,) = figure.axes[5].containers
    own = np.degrees(np.angle(z["velocity"].values))
    np.testing.assert_allclose(phases.lines[0].get_ydata(), own)
    angle = np.degrees(np.arcsin(z["confidence"].values / np.abs(z["velocity"].values)))
    np.testing.assert_allclose(half_lengths(phases), angle)
    assert left[-1].get_xlabel() == "frequency, Hz"


@pytest.mark.whole
@pytest.mark.parametrize("value", [np.nan, 0.0])
def test_a_spectrum_in_which_nothing_is_determined_is_drawn_too(value):
    own = groups.point(1, 40)
    own["velocity"].values[:] = value
    figure = sldvexp.plot.point({"point": own})
    figure.draw_without_rendering()
    said = "not above its bound at any frequency"
    assert all(axes.texts[0].get_text().replace("\n", " ") == said for axes in figure.axes[1::2])


def test_repeats_have_their_scatter_and_its_interval():
    dac = np.random.default_rng(0).uniform(-1000, 1000, (16, 2))
    tree = groups.repeats(dac)
    figure = sldvexp.plot.repeatability(tree)
    left_right, up_down, scatter = figure.axes
    away = tree["registration"]["dac"] - tree["registration"]["dac"].mean("view")
    for axes, mirror in ((left_right, "left_right"), (up_down, "up_down")):
        drawn = [line.get_ydata() for line in axes.lines[1:]]
        np.testing.assert_allclose(drawn, away.sel(mirror=mirror).values)
    std = tree["examined/again"]["dac_std"].sel(mirror="left_right").values
    np.testing.assert_array_equal(scatter.containers[0].lines[0].get_ydata(), std)
    bar = np.asarray(scatter.containers[0].lines[2][0].get_segments()[0])[:, 1]
    # chi square with 3 degrees of freedom: 0.2158 and 9.3484 at 2.5 and 97.5 %
    np.testing.assert_allclose(bar / std[0], np.sqrt([3 / 9.3484, 3 / 0.2158]), rtol=1e-3)


def test_a_sweep_compares_its_runs():
    table = groups.sweep()
    figure = sldvexp.plot.sweep(table)
    assert "(1 without a result)" in figure.get_suptitle()
    for axes, component in zip(figure.axes, "xyz", strict=True):
        assert axes.get_title() == f"component {component}"
        assert axes.get_ylabel() == "point.velocity, mm/s"
        for container, seed in zip(axes.containers, (1, 2, 3), strict=True):
            own = table.sel(seed=seed, component=component)
            values = 1000 * np.abs(own["point.velocity"].values)
            np.testing.assert_allclose(container.lines[0].get_ydata(), values)
            first = half_lengths(container)[0]
            assert first == pytest.approx(1000 * float(own["point.velocity_std"][0]))
    with pytest.raises(UserError, match="there is no result point"):
        sldvexp.plot.sweep(table, "point.sse")


def test_a_missed_run_has_a_result_and_a_ring():
    table = groups.sweep()
    table["state"][0, 1] = "missed"
    figure = sldvexp.plot.sweep(table)
    assert "of 6 runs (1 without a result)" in figure.get_suptitle()
    for axes, component in zip(figure.axes, "xyz", strict=True):
        rings = [line for line in axes.lines if line.get_label() == "missed an expectation"]
        own = table["point.velocity"].sel(seed=2, component=component).values[0]
        assert [r.get_ydata().tolist() for r in rings] == [[pytest.approx(1000 * abs(own))]]
    told = [t.get_text() for t in figure.legends[0].get_texts()]
    assert told[-1] == "missed an expectation"  # after the runs
    assert told[:-1] == ["1", "2", "3"]
    table["state"][1, 2] = "missed"  # it left a dataset, but not this number
    assert "(1 without a result)" in sldvexp.plot.sweep(table).get_suptitle()


def test_points_are_a_surface_where_their_velocity_brings_them():
    tree = {"point": groups.points(), "line_of_sight": groups.joined()}
    figure = sldvexp.plot.surface(tree, component="z", frequency=450.0)
    axes, scale = figure.axes
    faces, resting, moved, dots = axes.collections
    velocity = groups.points()["velocity"].values[:, :, 1]
    largest = velocity[np.abs(velocity[:, 2]).argmax(), 2]
    now = 1000 * (velocity * np.conj(largest) / abs(largest)).real
    limit = np.abs(now[:, 2]).max()
    colours = matplotlib.colormaps[SIGN_MAP]

    def coloured(values):
        return colours((values / limit + 1) / 2)[:, :3]

    np.testing.assert_allclose(np.asarray(dots._facecolors)[:, :3], coloured(now[:, 2]), atol=1e-9)
    mean = now[[[0, 1, 2], [1, 3, 2]], 2].mean(axis=1)
    np.testing.assert_allclose(faces._facecolor3d[:, :3], coloured(mean), atol=1e-9)
    assert scale.get_ylim() == pytest.approx((-limit, limit))
    rest = 1000 * groups.joined()["position"].values
    away = np.array(dots._offsets3d).T - rest
    factor = (away * now).sum() / (now**2).sum()
    np.testing.assert_allclose(away, factor * now, atol=1e-9)
    np.testing.assert_allclose(resting._segments3d, rest[[[0, 1], [1, 3], [3, 4]]])
    np.testing.assert_allclose(moved._segments3d, (rest + away)[[[0, 1], [1, 3], [3, 4]]])
    assert scale.get_ylabel() == "velocity along z, mm/s"
    assert axes.get_xlabel() == "x, mm"
    with pytest.raises(UserError, match="no component n, only x, y, z"):
        sldvexp.plot.surface(tree, component="n")
    with pytest.raises(UserError, match="points have no depth"):
        sldvexp.plot.surface(tree, depth=0.0)


def test_points_without_triangles_and_undetermined_ones_are_drawn_too():
    group = groups.points()
    group["velocity"].values[4] = np.nan
    tree = {"point": group, "line_of_sight": groups.joined().drop_vars(["triangle", "line"])}
    (axes, _) = sldvexp.plot.surface(tree).axes
    counts = [len(c._offsets3d[0]) for c in axes.collections if hasattr(c, "_offsets3d")]
    assert counts == [4, 1]
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["not determined"]


def test_points_of_which_nothing_is_determined_are_no_surface():
    own = groups.points()
    own["velocity"].values[:] = np.nan
    known = sldvexp.plot.figures_of({"point": own, "line_of_sight": groups.joined()})
    assert "surface" not in known
    assert "point" in known


def test_a_point_goes_by_its_name():
    point = groups.points()
    name = str(point["point"].values[1])
    assert (
        sldvexp.plot.point({"point": point}, 1)
        .get_suptitle()
        .startswith(f"Velocity of point {name}")
    )
    assert name != "1"


def test_whole_numbers_have_no_ticks_between_them():
    known = {"seed": [1, 2, 3], "state": ("seed", ["done"] * 3), "reason": ("seed", [""] * 3)}
    table = xr.Dataset({"pose.s": ("seed", [0.7, 0.8, 0.6], {"units": "1"}), **known})
    table.attrs = {"keys": ["seed"], "ranked_by": "pose.s"}
    figure = sldvexp.plot.sweep(table)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert axes.get_ylabel() == "pose.s"
    assert all(tick == round(tick) for tick in axes.get_xticks())


def test_a_run_is_no_sweep(tree):
    with pytest.raises(UserError, match="this is no sweep"):
        sldvexp.plot.sweep(tree)


#: Settings of a laser that are none of this version's, and what is said of them.
LASERS = {
    "an unknown key": ({"laser": {"no_such": 1}}, "laser.no_such is not a known setting"),
    "a wrong type": ({"laser": {"mirror_offset": "many"}}, "laser.mirror_offset must be a"),
    "no table": ({"laser": None}, "configuration has no table laser"),
}


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("settings", "told"), LASERS.values(), ids=LASERS)
def test_a_laser_of_another_version_is_told_of_and_pictures_are_drawn(tree, settings, told):
    config = OmegaConf.merge(OmegaConf.create(str(tree.attrs["config"])), settings)
    attributes = {**tree.attrs, "config": OmegaConf.to_yaml(config)}
    own = dataset.RunData.from_source(tree)
    run = dataclasses.replace(own, attributes=attributes)
    assert len(sldvexp.plot.images(run).axes) >= 4
    with pytest.raises(UserError, match=rf"^plot: as seen: the run's {told}"):
        sldvexp.plot.conics(run)


def test_the_users_style_is_neither_used_nor_changed():
    with matplotlib.rc_context({"font.size": 31.0, "axes.grid": False}):
        figure = sldvexp.plot.point({"point": groups.point(1)})
        assert figure.axes[0].xaxis.label.get_fontsize() == 8.0
        assert matplotlib.rcParams["font.size"] == 31.0


def test_curves_differ_without_their_colour():
    seen = [(look["marker"], look["linestyle"]) for look in looks(36)]
    assert len(set(seen)) == len(seen)
    lightness = [
        int(c[1:3], 16) * 0.30 + int(c[3:5], 16) * 0.59 + int(c[5:], 16) * 0.11 for c in COLOURS
    ]
    assert all(abs(a - b) > 5 for a, b in itertools.pairwise(lightness))


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.02], (1e3, "mm/s")),
        ([-3e-5, np.nan], (1e6, "µm/s")),
        ([1.0], (1.0, "m/s")),
        ([0.0], (1.0, "m/s")),
        ([], (1.0, "m/s")),
        ([1e-3], (1e3, "mm/s")),
        ([2500.0], (1e-3, "km/s")),
    ],
)
def test_units_get_a_handy_prefix(values, expected):
    assert prefixed(values, "m/s") == (pytest.approx(expected[0]), expected[1])


@pytest.mark.whole
def test_files_are_the_same_each_time(tmp_path):
    tree = {"point": groups.point(1, 1)}
    first = sldvexp.plot.save(sldvexp.plot.point(tree), tmp_path / "one" / "point")
    again = sldvexp.plot.save(sldvexp.plot.point(tree), tmp_path / "two" / "point")
    assert [p.name for p in first] == ["point.png", "point.svg"]
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in again]
    text = first[1].read_text()
    assert "<dc:date>" not in text
    assert "http" not in text.replace("http://www.w3.org", "").replace(
        "http://purl.org", ""
    ).replace("http://creativecommons.org", "")


def test_a_notebook_shows_a_figure():
    figure = sldvexp.plot.point({"point": groups.point(1, 1)})
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        sldvexp.plot.save(sldvexp.plot.point({"point": groups.point(1)}), tmp_path / "taken" / "p")


@pytest.mark.whole
def test_the_command_writes_beside_the_run(sldvexp, tmp_path):
    dataset.save({"point": groups.point(1)}, {}, tmp_path / "run.nc")
    done = sldvexp("plot", str(tmp_path))
    assert done.status == 0, done.err
    written = sorted(p.name for p in (tmp_path / "figures").iterdir())
    assert written == ["point.png", "point.svg"]
    assert done.out.split() == [str(tmp_path / "figures" / name) for name in written]
    dataset.save_table(groups.sweep(), tmp_path / "sweep.nc")
    (tmp_path / "run.nc").unlink()
    assert sldvexp("plot", str(tmp_path), "sweep").status == 0
    assert (tmp_path / "figures" / "sweep.svg").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "plot takes a run.nc"),
        (["run.nc", "fild"], "there is no figure fild; did you mean field"),
        (["run.nc", "field"], "the run has no velocity field"),
        (["nowhere"], "nowhere: there is no such file"),
        (["."], "neither run.nc nor sweep.nc"),
    ],
)
def test_the_command_refuses_in_one_sentence(sldvexp, tmp_path, words, said):
    if "run.nc" in words:
        dataset.save({"point": groups.point(1)}, {}, tmp_path / "run.nc")
    done = sldvexp("plot", *words)
    assert done.status != 0
    assert said in done.err
    assert "Traceback" not in done.err
    assert not (tmp_path / "figures").exists()


def test_matplotlib_is_loaded_with_the_first_figure(loaded_by):
    libraries, said = loaded_by("import sldvexp.plot; print(len(sldvexp.plot.__all__))")
    assert libraries == ""
    assert int(said) > 15


def test_rows_of_unlike_views_stand_close_and_their_numbers_do_not_meet():
    """A narrow image and a wide one of a 16-bit board: each row has the height of its own."""
    groups = {}
    for name, tall, wide in (("a", 13000, 8000), ("b", 9000, 21000)):
        up, right = np.meshgrid([-tall, 0, tall], [-wide, 0, wide], indexing="ij")
        dac = np.stack([up.ravel(), right.ravel()], axis=1)
        velocity = 0.01 * np.exp(1j * np.arange(9.0))
        groups[f"image/{name}"] = dataset.group("image", {}, velocity=velocity, dac=dac)
    made = sldvexp.plot.images(groups)
    made.canvas.draw()
    panels = np.array(made.axes[:8]).reshape(2, 4)
    high = [axes.get_position(original=True).height for axes in panels[:, 0]]
    assert high[0] / high[1] == pytest.approx((13 / 8) / (9 / 21), rel=0.05)
    boxes = [
        label.get_window_extent()
        for axes in panels[1]
        for label in axes.get_xticklabels()
        if label.get_text()
    ]
    boxes.sort(key=lambda box: box.x0)
    assert all(one.x1 < other.x0 for one, other in itertools.pairwise(boxes))
