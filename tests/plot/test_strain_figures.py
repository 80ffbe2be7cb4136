"""Maps of strain: what they show, of flat surfaces and of bent ones, and what they mark."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import LineCollection

from sldvexp.errors import UserError
from sldvexp.plot import figures_of, hot_spots, hottest_places, strain
from sldvexp.plot.paper import SETTINGS
from sldvexp.plot.strain_maps import StrainMap
from sldvexp.volume import Grid, Revolution
from tests.plot.test_figures import labels_are_inside_and_apart
from tests.shell.made_strain import made_strain


def group(radius=None, **settings):
    grid = Grid(center=[0.4, 0.1, 0], size=[0.3, 0.2], shape=[13, 9], layers=2, radius=radius)
    return made_strain(grid.group(), **settings)


@pytest.fixture(scope="module", params=[None, 0.3], ids=["flat", "bent"])
def made(request):
    return group(request.param)


@pytest.mark.whole
@pytest.mark.parametrize("draw", [hot_spots, strain])
def test_labels_are_inside_and_apart(made, draw):
    figure = draw({"strain": made})
    figure.draw_without_rendering()
    with matplotlib.rc_context(SETTINGS):
        labels_are_inside_and_apart(figure)


def test_a_flat_surface_has_the_axes_of_the_world_and_a_bent_one_its_own():
    flat, bent = (hot_spots({"strain": group(r)}).axes[2] for r in (None, 0.3))
    assert (flat.get_xlabel(), flat.get_ylabel()) == ("x, mm", "y, mm")
    assert flat.get_xlim() == pytest.approx((250, 550))
    assert (bent.get_xlabel(), bent.get_ylabel()) == ("along t1, mm", "along t2, mm")


def test_a_tube_is_cut_open_where_its_first_coordinate_comes_back():
    tube = made_strain(Revolution(profile=[[0.1, -0.1], [0.1, 0.1]], layers=2).group())
    x, y, z = tube["position"].values.T
    around = np.column_stack([0.1 * np.arctan2(x, z), y])
    rolled = StrainMap.of(
        tube.assign(coordinate=(tube["coordinate"].dims, around)).isel(frequency=0)
    )
    wide = np.ptp(rolled.mesh.x[rolled.mesh.triangles], axis=1)
    assert wide.max() < 20.0
    assert len(wide) == len(tube["triangle"]) - 2 * 8  # cells of one row


@pytest.mark.one_in(2)
def test_maps_are_of_the_strains_at_the_strongest_frequency(made):
    shown = strain({"strain": made})
    values = np.abs(made["strain"].values[:, 0, 0])
    drawn = shown.axes[0].collections[0].get_array()
    assert 1e-6 * np.asarray(drawn) == pytest.approx(values)
    assert "197 Hz" in shown.get_suptitle()
    assert "439 Hz" in strain({"strain": made}, frequency=430.0).get_suptitle()


def test_ticks_point_along_the_largest_extension(made):
    one = made.isel(frequency=0)
    axes = hot_spots({"strain": made}).axes[0]
    ticks = [c for c in axes.collections if isinstance(c, LineCollection)][-1]
    segments = np.array(ticks.get_segments())
    way = segments[:, 1] - segments[:, 0]
    angle = np.degrees(np.arctan2(way[:, 1], way[:, 0]))
    known = one["principal_direction_std"].values < 15
    expected = np.median(one["principal_direction"].values[known])
    assert len(segments) > 10
    assert np.median((angle - expected + 90) % 180 - 90) == pytest.approx(0, abs=2)


def test_hot_spots_are_numbered_in_their_order():
    made = group()
    at = made.sel(frequency=439.0)
    places = hottest_places(at)
    assert len(places) == 2
    axes = hot_spots({"strain": made}, frequency=439.0).axes[2]
    assert [t.get_text() for t in axes.texts] == ["1", "2"]
    marked = np.array([t.xy for t in axes.texts])
    assert marked == pytest.approx(1e3 * at["position"].values[places, :2])


def test_without_a_material_hot_spots_are_those_of_the_extension():
    made = group(stress=False)
    figure = hot_spots({"strain": made})
    assert [a.get_title() for a in figure.axes[:2]] == [
        "largest extension",
        "largest extension: 95% bound",
    ]
    assert [t.get_text() for t in figure.axes[0].texts] == ["1"]


def test_strains_of_compared_methods_can_be_named():
    of = {"strain": group(), "compare_strain/spline": group(hertz=(300.0,))}
    assert "300 Hz" in hot_spots(of, name="spline").get_suptitle()
    assert "197 Hz" in hot_spots(of).get_suptitle()
    with pytest.raises(UserError, match="there is no strain free"):
        strain(of, name="free")


def test_both_stand_in_the_catalogue():
    assert {"strain", "hot_spots"} <= set(figures_of({"strain": group()}))
    with pytest.raises(UserError, match="reconstruction=shell or spline"):
        strain({})
