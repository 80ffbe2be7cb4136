"""Two runs beside each other: which nodes are the same, and how alike their shapes are."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.report.html.blocks import Beside, HtmlTable, Shape, Text
from sldvexp.report.html.pair import mac, pair_section, same_nodes


def of_kind(section, kind):
    return [block for block in section.blocks if isinstance(block, kind)]


def test_mac_is_one_of_multiples_and_zero_of_shapes_with_nothing_in_common():
    a = np.array([[1, 2j, 3], [0, 3, 2j]], complex)
    found = mac(a, np.array([(1 - 2j) * a[0], [0, 3, -2j]]))
    both = abs(np.vdot(a[0], [0, 3, -2j])) ** 2 / (14 * 13)
    np.testing.assert_allclose(found, [[1, both], [0, (9 - 4) ** 2 / 13**2]], atol=1e-12)
    a[0, 1] = np.nan  # what one does not know does not count
    np.testing.assert_allclose(mac(a, a)[1], [abs(3 * 2j) ** 2 / (10 * 4), 1])


def test_nodes_at_the_same_place_are_found_in_any_order():
    rng = np.random.default_rng(2)
    first, order = rng.uniform(size=(40, 3)), rng.permutation(40)
    second = first[order] + 1e-4
    second[order == 7] += 1
    own, other = same_nodes(first, second)
    assert own.tolist() == [n for n in range(40) if n != 7]
    np.testing.assert_array_equal(order[other], own)


@pytest.fixture
def two_runs(tmp_path, write_run, small_volume, small_field):
    """Write two runs whose second has the first's shapes turned in phase, frequencies swapped."""

    def written(change=None):
        around, paths = small_volume(), []
        for name in "ab":
            field = small_field(around)
            if name == "b":
                field["velocity"].values[:] = (2 + 1j) * field["velocity"].values[:, :, ::-1]
                if change:
                    change(around, field)
            (tmp_path / name).mkdir(exist_ok=True)
            paths.append(write_run(tmp_path / name, volume=around, field=field))
        return paths

    return written


def test_two_runs_are_shown_beside_each_other_with_their_mac(two_runs, small_volume, small_field):
    section = pair_section(two_runs(), ["one", "other"])
    (beside,), (table,) = of_kind(section, Beside), of_kind(section, HtmlTable)
    shapes = [next(b for b in column if isinstance(b, Shape)) for column in beside.columns]
    assert [shape.name for shape in shapes] == ["shape", "other"]
    assert [shape.data["partners"] for shape in shapes] == [[1, 0], [1, 0]]
    around = small_volume()
    nodes = np.flatnonzero(around["node_layer"].values == 1)
    one, two = small_field(around)["velocity"].values[nodes].transpose(2, 0, 1).reshape(2, -1)
    alike = abs(np.vdot(one, two)) ** 2 / (np.vdot(one, one) * np.vdot(two, two)).real
    assert table.columns == ["one \\ other", "197 Hz", "439 Hz"]
    assert [row[0] for row in table.rows] == ["197 Hz", "439 Hz"]
    told = np.array([[float(cell) for cell in row[1:]] for row in table.rows])
    np.testing.assert_allclose(told, [[alike, 1], [1, alike]], rtol=5e-3)


@pytest.mark.whole
def test_components_along_the_surface_are_compared_along_the_worlds_axes(
    tmp_path, write_run, small_volume, small_field
):
    around = small_volume("local", radius=0.4)
    field = small_field(around, "local")
    frame = around["frame"].sel(local_axis=["t1", "t2", "n"]).transpose("surface_node", ...)
    paths = []
    for name in ("local", "world"):
        own = field.copy(deep=True)
        if name == "world":
            surfaces = np.tile(frame.values, (3, 1, 1))
            turned = np.einsum("ncf,nca->naf", field["velocity"].values, surfaces)
            own["velocity"].values[:] = turned
            own = own.assign_coords(component=["x", "y", "z"])
        (tmp_path / name).mkdir()
        paths.append(write_run(tmp_path / name, "local", 0.4, volume=around, field=own))
    (table,) = of_kind(pair_section(paths, ["local", "world"]), HtmlTable)
    assert [table.rows[i][i + 1] for i in (0, 1)] == ["1", "1"]


@pytest.mark.whole
def test_runs_of_other_places_have_no_mac(two_runs):
    def moved(around, field):
        around["position"].values[:] += 1.0
        field["position"].values[:] += 1.0

    section = pair_section(two_runs(moved), ["one", "other"])
    assert of_kind(section, HtmlTable) == []
    assert "no nodes at the same places" in of_kind(section, Text)[0].text


def test_a_run_without_a_shape_is_no_pair(tmp_path, two_runs):
    empty = tmp_path / "run.nc"
    dataset.save({}, {"config": "{}", "plugins": "{}"}, empty)
    assert pair_section([two_runs()[0], empty], ["one", "other"]) is None


def test_points_are_compared_too(tmp_path, small_points):
    point, lines_of_sight = small_points
    paths = []
    for name in "ab":
        (tmp_path / name).mkdir()
        path = tmp_path / name / "run.nc"
        groups = {"point": point, "line_of_sight": lines_of_sight}
        dataset.save(groups, {"config": "{}", "plugins": "{}"}, path)
        paths.append(path)
    (table,) = of_kind(pair_section(paths, ["a", "b"]), HtmlTable)
    assert [table.rows[i][i + 1] for i in (0, 1)] == ["1", "1"]


@pytest.mark.whole
def test_of_two_runs_with_modes_these_are_compared(
    tmp_path, write_run, small_volume, small_field, no_figures
):
    around, paths = small_volume(), []
    for name, order in (("a", [0, 1]), ("b", [1, 0])):
        shapes = small_field(around, hertz=(200.0, 440.0)).isel(frequency=order)
        shapes = shapes.assign_coords(frequency=[200.0, 440.0])
        (tmp_path / name).mkdir()
        paths.append(write_run(tmp_path / name, volume=around, **{"modes/field": shapes}))
    section = pair_section(paths, ["one", "other"])
    (beside,), (table,) = of_kind(section, Beside), of_kind(section, HtmlTable)
    shapes = [next(b for b in column if isinstance(b, Shape)) for column in beside.columns]
    assert [shape.data["frequencies"] for shape in shapes] == [[200.0, 440.0]] * 2
    assert [shape.data["partners"] for shape in shapes] == [[1, 0], [1, 0]]
    assert table.columns[1:] == ["200 Hz", "440 Hz"]
    lines = small_field(around)
    paths[1] = write_run(tmp_path / "b", volume=around, field=lines)
    (beside,) = of_kind(pair_section(paths, ["one", "other"]), Beside)
    assert all(c[0].data["frequencies"] == [197.0, 439.0] for c in beside.columns)
