"""Velocities in CSV and MATLAB files as people write them: read alike, or asked about."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from sldvexp import dataset
from sldvexp.errors import ConfigError, UserError
from sldvexp.importers.velocity_file import File
from sldvexp.units import LengthUnit

CASES = Path(__file__).parent / "cases"
EXAMPLE = Path(__file__).parents[2] / "conf" / "data" / "point_example.csv"
MATLAB_73 = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: somewhere"


@pytest.mark.parametrize("name", ["p_latin.csv", "p_semi.csv"])
def test_encodings_and_decimal_commas(name):
    one, two = File(path=str(CASES / "csv" / name)).read(), File(path=str(EXAMPLE)).read()
    np.testing.assert_array_equal(one["velocity"], two["velocity"])
    np.testing.assert_array_equal(one["velocity_std"], two["velocity_std"])
    if name == "p_semi.csv":
        assert list(one["view"].values) == list(two["view"].values)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-32", "cp1252"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_every_form_of_a_table_is_read_the_same(tmp_path, encoding, delimiter, end):
    text = EXAMPLE.read_text("utf-8").replace("# Example", "# Exämple")
    if delimiter != ",":
        lines = text.splitlines()
        kept = [line.replace(",", delimiter) for line in lines if not line.startswith("#")]
        text = "\n".join(kept).replace(".", ",")
    path = tmp_path / "mine.csv"
    path.write_bytes(text.replace("\n", end).encode(encoding))
    np.testing.assert_array_equal(
        File(path=str(path)).read()["velocity"], File(path=str(EXAMPLE)).read()["velocity"]
    )


POSITIONS = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.2, 0], [0, 0.2, 0.01]])
DIRECTIONS = np.array([[0.0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8]])
VALUES = np.arange(1, 25).reshape(3, 4, 2) * (1e-3 + 2e-3j)


def rows(lost=(), empty=(), header="x_mm,y_mm,z_mm", factor=1000):
    lines = [f"view,point,{header},dx,dy,dz,frequency,real,imag,std"]
    for v, p, f in np.ndindex(3, 4, 2):
        z = VALUES[v, p, f]
        cells = [f"v{v}", f"p{p}", *(factor * POSITIONS[p]), *DIRECTIONS[v], 100 * (f + 1)]
        cells += ["", "nan", "-"] if (v, p, f) in empty else [z.real, z.imag, 1e-6]
        if (v, p, f) not in lost:
            lines.append(",".join(map(str, cells)))
    return "\n".join(lines) + "\n"


@pytest.fixture
def read(tmp_path):
    def read_(text, **settings):
        path = tmp_path / "mine.csv"
        path.write_text(text)
        return File(path=str(path), **settings).read()

    return read_


@pytest.mark.parametrize(
    ("header", "factor", "settings"),
    [
        ("x_mm,y_mm,z_mm", 1000, {}),
        ("x,y,z", 1, {}),
        ("x,y,z", 100, {"length_unit": LengthUnit.cm}),
    ],
)
def test_points_may_have_positions(read, header, factor, settings):
    group = read(rows(header=header, factor=factor), **settings)
    np.testing.assert_allclose(group["position"], POSITIONS, atol=1e-15)
    np.testing.assert_array_equal(group["velocity"], VALUES)


WRONG_PLACES = {
    "two of three": (rows(header="x,y,std").replace("imag,std", "imag,x"), "stands twice"),
    "an axis is missing": (
        "view,dx,dy,dz,real,x,y\na,0,0,1,1,0,0\n",
        "the column z is missing; needed are x, y, z or x_U",
    ),
    "mixed units": (rows(header="x_mm,y_m,z_mm"), "the columns x, y, z mix the units m and mm"),
    "two places": (
        rows().replace("v1,p1,100.0", "v1,p1,101.0"),
        "point p1 has more than one position",
    ),
    "no point": (
        "view,dx,dy,dz,real,x,y,z\na,0,0,1,1,0,0,0\nb,0,0,1,1,1,0,0\n",
        "the point has more than one position; each point needs one",
    ),
    "no number": (rows().replace("p2,100.0", "p2,", 1), "line 6: x_mm must be a finite number"),
}


@pytest.mark.parametrize("name", WRONG_PLACES)
def test_wrong_positions_are_named(read, name):
    text, said = WRONG_PLACES[name]
    with pytest.raises(UserError) as error:
        read(text)
    assert said in str(error.value), str(error.value)


GAPS = {
    "a row of each frequency": {"lost": [(1, 2, 0), (1, 2, 1)]},
    "a row of one frequency": {"lost": [(1, 2, 1)]},
    "empty cells": {"empty": [(1, 2, 0)]},
}


@pytest.mark.parametrize("name", GAPS)
def test_missing_values_are_refused_dropped_or_marked(read, name):
    text = rows(**GAPS[name])
    with pytest.raises(UserError, match=r"instrument\.incomplete=drop, or keep them marked with"):
        read(text)
    for drop in ("drop", True, "true"):
        group = read(text, incomplete=drop)
        assert list(group["point"].values) == ["p0", "p1", "p3"]
        np.testing.assert_array_equal(group["velocity"], VALUES[:, [0, 1, 3]])
        np.testing.assert_allclose(group["position"], POSITIONS[[0, 1, 3]])
        (found,) = dataset.take_findings({"line_of_sight": group})
        assert found.text == (
            "1 of 4 points are left out, as not all views have values there (missing: view v0 0, "
            "view v1 1, view v2 0)"
        )
    group = read(text, incomplete="mark")
    (gaps,) = GAPS[name].values()
    gone = np.zeros(VALUES.shape, int)
    for place in gaps:
        gone[place] = 1
    np.testing.assert_array_equal(group["flags"], gone)
    np.testing.assert_array_equal(group["velocity"], np.where(gone, np.nan, VALUES))
    assert dataset.take_findings({"line_of_sight": group})[0].size == 1


def test_a_single_point_loses_frequencies(read):
    text = "view,dx,dy,dz,frequency,real\na,0,0,1,1,5\na,0,0,1,2,6\nb,0,1,0,2,7\n"
    group = read(text, incomplete="drop")
    np.testing.assert_array_equal(group["velocity"], [[6], [7]])
    np.testing.assert_array_equal(group["frequency"], [2])
    with pytest.raises(UserError, match="in all of it some view has no velocity"):
        read("view,dx,dy,dz,frequency,real\na,0,0,1,1,5\nb,0,1,0,2,7\n", incomplete="drop")


def test_what_incomplete_may_be():
    with pytest.raises(ConfigError, match="incomplete: must be false, drop or mark, not maybe"):
        File(path="x.csv", incomplete="maybe")


def write_73(path, arrays):
    """Write arrays, texts, cells of texts and structs as MATLAB 7.3 does."""
    with h5py.File(path, "w", userblock_size=512) as file:
        store = file.create_group("#refs#")

        def put(group, name, value):
            if isinstance(value, dict):
                own = group.create_group(name)
                own.attrs["MATLAB_class"] = np.bytes_(b"struct")
                for field, inner in value.items():
                    put(own, field, inner)
            elif isinstance(value, list):
                references = []
                for one in value:
                    at = f"r{len(store)}"
                    put(store, at, one)
                    references.append(store[at].ref)
                made = group.create_dataset(
                    name, data=np.array([references], h5py.ref_dtype), dtype=h5py.ref_dtype
                )
                made.attrs["MATLAB_class"] = np.bytes_(b"cell")
            elif isinstance(value, str):
                codes = np.array([[ord(c)] for c in value], np.uint16)
                group.create_dataset(name, data=codes).attrs["MATLAB_class"] = np.bytes_(b"char")
            else:
                array = np.atleast_2d(value).T
                if np.iscomplexobj(array):
                    pairs = np.empty(array.shape, [("real", "f8"), ("imag", "f8")])
                    pairs["real"], pairs["imag"] = array.real, array.imag
                    array = pairs
                group.create_dataset(name, data=array).attrs["MATLAB_class"] = np.bytes_(b"double")

        for name, value in arrays.items():
            put(file, name, value)
    with path.open("r+b") as raw:
        raw.write(MATLAB_73.ljust(124) + b"\x00\x02IM")


def write_5(path, arrays):
    def cells(value):
        if isinstance(value, dict):
            return {name: cells(inner) for name, inner in value.items()}
        if not isinstance(value, list):
            return value
        made = np.empty(len(value), object)
        made[:] = value
        return made

    scipy.io.savemat(path, cells(arrays))


WRITERS = {"5": write_5, "7.3": write_73}


def test_names_in_cells_of_version_7_3():
    group = File(path=str(CASES / "mat" / "v73_cell.mat")).read()
    with h5py.File(CASES / "mat" / "v73_cell.mat") as file:
        known = ["".join(map(chr, file[r][:, 0])) for r in file["view"][:].ravel()]
        velocity = file["velocity"][:].T
    assert list(group["view"].values) == known
    np.testing.assert_array_equal(group["velocity"], velocity["real"] + 1j * velocity["imag"])


def test_arrays_in_a_struct_of_version_5():
    group = File(path=str(CASES / "mat" / "v5_struct.mat")).read()
    expected = np.array([[1 + 2j, 3 + 1j], [2 - 1j, 1j], [0.5, 0.7 + 0.1j]])
    np.testing.assert_allclose(group["velocity"], 1e-3 * expected)
    np.testing.assert_array_equal(group["frequency"], [100, 200])


ARRAYS = {
    "direction_cosines": np.tile(DIRECTIONS[:, None], (1, 4, 1)),
    "velocity": VALUES,
    "frequency": np.array([100.0, 200.0]),
    "view": ["front", "left", "above"],
    "point": ["a", "b", "c", "d"],
    "position": POSITIONS,
    "triangle": np.array([[1.0, 2, 3], [1, 3, 4]]),
}


def right(group):
    np.testing.assert_array_equal(group["velocity"], VALUES)
    np.testing.assert_allclose(group["position"], POSITIONS)
    np.testing.assert_array_equal(group["triangle"], [[0, 1, 2], [0, 2, 3]])
    assert list(group["view"].values) == ["front", "left", "above"]
    assert list(group["point"].values) == ["a", "b", "c", "d"]


@pytest.mark.parametrize("version", WRITERS)
def test_cells_and_structs_of_both_versions(tmp_path, version):
    path = tmp_path / "mine.mat"
    WRITERS[version](path, ARRAYS)
    right(File(path=str(path)).read())
    WRITERS[version](path, {"mine": ARRAYS, "note": "hello"})
    right(File(path=str(path)).read())
    deep = {
        "mine": {"results": {"V": VALUES}},
        **{k: v for k, v in ARRAYS.items() if k != "velocity"},
    }
    WRITERS[version](path, deep)
    right(File(path=str(path), mapping={"mine.results.V": "velocity"}).read())
    WRITERS[version](path, ARRAYS | {"velocity": [VALUES[0], VALUES[1], VALUES[2]]})
    right(File(path=str(path)).read())


@pytest.mark.parametrize("version", WRITERS)
def test_the_order_is_that_of_all_arrays(tmp_path, version):
    path = tmp_path / "mine.mat"
    turned = {
        "velocity": VALUES.transpose(2, 1, 0),
        "std": np.full((2, 4, 3), 1e-6),
        "direction_cosines": ARRAYS["direction_cosines"].transpose(2, 1, 0),
        "position": POSITIONS.T,
    }
    WRITERS[version](path, ARRAYS | turned)
    right(File(path=str(path), order=["frequency", "axis", "point", "view"]).read())
    with pytest.raises(UserError, match="they must agree in views and points"):
        File(path=str(path)).read()
    del turned["direction_cosines"], turned["position"]
    turned["direction_cosines"] = ARRAYS["direction_cosines"].transpose(1, 0, 2)
    WRITERS[version](path, ARRAYS | turned)
    right(File(path=str(path), order=["frequency", "point", "view"]).read())


@pytest.mark.parametrize("version", WRITERS)
def test_a_file_that_lacks_an_array_is_told_by_what_it_has(tmp_path, version):
    path = tmp_path / "mine.mat"
    WRITERS[version](path, {"V": VALUES, "run": {"D": DIRECTIONS}})
    with pytest.raises(UserError) as error:
        File(path=str(path)).read()
    assert str(error.value) == (
        f"{path}: the array direction_cosines is missing; needed are direction_cosines, velocity; "
        "the file has V (3 x 4 x 2 complex), run.D (3 x 3), of which instrument.mapping may call "
        "one so"
    )
    WRITERS[version](path, {"one": ARRAYS, "two": ARRAYS})
    with pytest.raises(UserError, match=r"the structs one and two have all .*\{one\.velocity: vel"):
        File(path=str(path)).read()


def test_netcdf_has_positions_and_gaps(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text(rows(empty=[(1, 2, 0)]))
    group = File(path=str(path), incomplete="mark").read()
    group.to_netcdf(tmp_path / "mine.nc", engine="netcdf4", auto_complex=True)
    settings = {"path": str(tmp_path / "mine.nc")}
    with pytest.raises(
        UserError,
        match=r"the velocity of view v1, point p2, 100 Hz is nan.*, but must be finite; leave",
    ):
        File(**settings).read()
    again = File(**settings, incomplete="mark").read()
    for name in ("velocity", "position", "flags", "velocity_std"):
        np.testing.assert_array_equal(again[name], group[name])
    whole = File(**settings, incomplete="drop").read()
    np.testing.assert_allclose(whole["position"], POSITIONS[[0, 1, 3]])
    places = group.drop_vars("position").assign(
        {axis: ("point", 1e3 * POSITIONS[:, i], {"units": "mm"}) for i, axis in enumerate("xyz")}
    )
    places.to_netcdf(tmp_path / "other.nc", engine="netcdf4", auto_complex=True)
    other = File(path=str(tmp_path / "other.nc"), incomplete="mark").read()
    np.testing.assert_allclose(other["position"], POSITIONS)


@pytest.mark.whole
def test_a_run_of_a_table_with_positions_is_a_shape_and_is_exported(tmp_path, sldvexp, pages):
    x, y = np.meshgrid(np.linspace(0, 0.2, 4), np.linspace(0, 0.1, 3))
    places = np.column_stack([x.ravel(), y.ravel(), np.zeros(12)])
    lines = ["view,point,x,y,z,dx,dy,dz,frequency,real,imag,std"]
    for name, stand in {"a": [0, 0, 1], "b": [1, 0, 1], "c": [0, 1, 1], "d": [-1, -1, 1]}.items():
        for i, place in enumerate(places):
            d = (stand - place) / np.linalg.norm(stand - place)
            v = d @ np.array([1e-3, 2e-3j, (5 + i) * 1e-3])
            if (name, i) != ("b", 5):
                cells = [name, i, *place, *d, 100, v.real, v.imag, 1e-7]
                lines.append(",".join(map(str, cells)))
    path = tmp_path / "grid.csv"
    path.write_text("\n".join(lines))
    made = sldvexp(
        "experiment=point",
        f"instrument.path={path}",
        "instrument.incomplete=mark",
        "+export={v: {plugin: vtu, phases: 3}, g: {plugin: ugrid}, u: {plugin: uff}, "
        "m: {plugin: mat}}",
    )
    point = made.tree["point"]
    expected = np.array([[1e-3, 2e-3j, (5 + i) * 1e-3] for i in range(12)])
    np.testing.assert_allclose(point["velocity"].values[..., 0], expected, atol=1e-9)
    assert point["observable"].values.all()
    assert point["confidence"].values[5].max() > 2 * point["confidence"].values[4].max()
    assert "views have measured are determined from fewer: 1 from 3" in point.attrs["notes"]
    assert "1 of 12 points are kept with the views that are there" in str(
        made.tree["verdict"]["text"].values.tolist()
    )
    page = (made.folder / "report.html").read_text(encoding="utf-8")
    assert "Points are joined to triangles in their plane" in page
    assert (
        'NumberOfPoints="12" NumberOfCells="12"'
        in (made.folder / "v" / "phase_00001.vtu").read_text()
    )
    assert "  2411\n" in (made.folder / "u.uff").read_text()
    struct = scipy.io.loadmat(made.folder / "m.mat")["sldvexp"][0, 0]
    np.testing.assert_allclose(struct["position"], places)
    assert struct["triangle"].shape == (12, 3)
