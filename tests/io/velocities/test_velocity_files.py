"""Line-of-sight velocities come out of every format the same, and wrong files are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.io
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.io.velocities import FileLayout, LineOfSight, read
from sldvexp.units import VelocityUnit

M_PER_S = VelocityUnit.m_per_s


def example(rng, views=4, points=None, frequencies=None, std=False, real=False):
    """Random velocities of the given sizes; None leaves a dimension unnamed."""
    p, f = points or 1, frequencies or 1
    cosines = rng.normal(size=(views, p, 3))
    cosines /= np.linalg.norm(cosines, axis=-1, keepdims=True)
    velocity = rng.normal(size=(views, p, f))
    if not real:
        velocity = velocity + 1j * rng.normal(size=velocity.shape)
    return LineOfSight(
        "made",
        [f"v{i}" for i in range(views)],
        [f"p{i}" for i in range(p)] if points else None,
        100.0 * np.arange(1, f + 1) if frequencies else None,
        cosines,
        velocity,
        rng.uniform(0.1, 1, size=velocity.shape) if std else None,
    )


@pytest.mark.parametrize("name", ["a\x1b[31m", "a\x9b31m", "a\r", "a\x7f"])
def test_names_that_would_act_on_a_terminal_are_refused(name):
    whole = example(np.random.default_rng(1), points=2)
    assert replace(whole, point=["a\u00a0b", "ä"]).point == ["a\u00a0b", "ä"]
    with pytest.raises(UserError, match=r"the point 'a.*' has characters in its name") as error:
        replace(whole, point=["b", name])
    assert str(error.value).isprintable()


def write_csv(path, table):
    """The long format, rows in a shuffled order that keeps first appearances."""
    columns = ["view", "dx", "dy", "dz", "real"]
    columns += ["point"] * (table.point is not None)
    columns += ["frequency"] * (table.frequency is not None)
    columns += ["imag"] * np.iscomplexobj(table.velocity) + ["std"] * (table.std is not None)
    lines = ["# a comment", ",".join(columns)]
    for v, p, f in np.ndindex(table.velocity.shape):
        d, z = table.direction_cosines[v, p], table.velocity[v, p, f]
        row = [table.view[v], *map(repr, d.tolist()), repr(float(z.real))]
        row += [table.point[p]] if table.point is not None else []
        row += [repr(float(table.frequency[f]))] if table.frequency is not None else []
        row += [repr(float(z.imag))] if np.iscomplexobj(z) else []
        row += [repr(float(table.std[v, p, f]))] if table.std is not None else []
        lines.append(",".join(row))
    path.write_text("\n".join(lines) + "\n")


def same(one, two):
    assert one.view == two.view
    assert one.point == two.point
    np.testing.assert_array_equal(one.direction_cosines, two.direction_cosines)
    np.testing.assert_array_equal(one.velocity, two.velocity)
    for a, b in ((one.frequency, two.frequency), (one.std, two.std)):
        assert (a is None) == (b is None)
        if a is not None:
            np.testing.assert_array_equal(a, b)


sizes = st.none() | st.integers(1, 4)


@pytest.mark.whole
@settings(max_examples=20, deadline=None, derandomize=True)
@given(points=sizes, frequencies=sizes, std=st.booleans(), real=st.booleans(), seed=st.integers(0))
def test_csv_and_netcdf_round_trip(tmp_path_factory, points, frequencies, std, real, seed):
    folder = tmp_path_factory.mktemp("files")
    table = example(np.random.default_rng(seed), 3, points, frequencies, std, real)
    write_csv(folder / "t.csv", table)
    same(read(folder / "t.csv", M_PER_S), table)
    table.to_dataset().to_netcdf(folder / "t.nc", engine="netcdf4", auto_complex=True)
    same(read(folder / "t.nc", M_PER_S), table)


def test_matlab_arrays(tmp_path):
    table = example(np.random.default_rng(1), 5, None, 3, std=True)
    arrays = {
        "direction_cosines": table.direction_cosines[:, 0],
        "velocity": 1e3 * table.velocity[:, 0],
        "std": 1e3 * table.std[:, 0],
        "frequency": table.frequency,
        "view": np.array(table.view, dtype=object),
    }
    scipy.io.savemat(tmp_path / "t.mat", arrays)
    found = read(tmp_path / "t.mat", VelocityUnit.mm_per_s)
    assert found.view == table.view
    np.testing.assert_allclose(found.velocity, table.velocity, rtol=1e-15)
    np.testing.assert_allclose(found.std, table.std, rtol=1e-15)


def test_thousands_of_frequencies(tmp_path):
    table = example(np.random.default_rng(2), 4, None, 3000)
    write_csv(tmp_path / "t.csv", table)
    same(read(tmp_path / "t.csv", M_PER_S), table)


HEAD = "view,dx,dy,dz,frequency,real,imag\n"


def test_blanks_around_names_mean_nothing(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(HEAD + "a,0,0,1,450,1,0\na ,0,0,1,500,1,0\n")
    assert read(path, M_PER_S).view == ["a"]


BAD = [
    ("view,dx,dy,dz\n1,0,0,1\n", "the column real is missing"),
    (
        "view,dx,dy,dz,real,phase\n",
        "unknown column 'phase'; say what it is with instrument.mapping={phase: }, ignore if ",
    ),
    (
        "head,dx,dy,dz,vlos,real\n",
        "has the unknown columns head, vlos, and lacks view; say which is what with "
        "instrument.mapping={head: , vlos: }, ignore if a column is of no use; Valid: view, dx,",
    ),
    (HEAD, "the table has no rows"),
    (
        "# c\n" + HEAD.replace(",", ";") + "1;0;0;1;450;0,5;0\n2;0;0;1;450;0.5;0\n",
        "line 4: has a decimal point, but line 3 a decimal comma; one of them is needed throughout",
    ),
    (
        HEAD.replace(",", ";") + "1;0;0;1;450;1,500;0\n2;0;0;1;450;2,250;0\n",
        "1,500 may be 1.500 or 1500; write decimal points, and nothing between thousands",
    ),
    (HEAD + "1,0,0,1,450,1_0,0\n", "line 2: real must be a finite number, not '1_0'"),
    (HEAD + "1,0,0,1,450,x,0\n", "line 2: real must be a finite number, not 'x'"),
    ("# c\n\n" + HEAD + "1,0,0,1,450,1,0\n1,0,0,1,500,inf,0\n", "line 5: real must be a finite"),
    (HEAD + "1,0,0,1,450,1,0\n1,0,0,1,450,1,0\n", "line 3: view 1, frequency 450 is given twice"),
    (HEAD + "1,0,0,1,450,1,0\n2,0,0,1,500,1,0\n", "no row for view 1, frequency 500"),
    (
        HEAD + "1,0,0,1,450,1,0\n1,0,1,0,500,1,0\n",
        "direction of view 1 differs between frequencies",
    ),
    (HEAD + "1,0,0,1.2,450,1,0\n", "the length of the direction of view 1 is 1.2, but must be 1"),
    (
        HEAD + "1,0,0,1,-450,1,0\n",
        "line 2: frequency must be a finite number of zero or more, not '-450'",
    ),
    ("view,dx,dy,dz,real,std\n1,0,0,1,1,0\n", "line 2: std must be a positive number, not '0'"),
    ("", "is empty; needed are the columns view, dx, dy, dz, real"),
    (HEAD + "1,0,0,1,450,1,0,7\n1,0,0,1,450,1,0,7,8\n", "line 2: has 8 values under 7 columns"),
]


def test_combinations_without_rows_take_no_memory(tmp_path):
    path = tmp_path / "t.csv"
    rows = (f"v{i},p{i},0,0,1,{i},1,0\n" for i in range(5000))
    path.write_text("view,point,dx,dy,dz,frequency,real,imag\n" + "".join(rows))
    with pytest.raises(UserError, match="no row for view v0, point p0, frequency 1 and 1249999949"):
        read(path, M_PER_S)
    said = "has 5000 of 125000000000 combinations of 5000 view, 5000 point, 5000 frequency; each"
    with pytest.raises(UserError, match=said):
        read(path, M_PER_S, FileLayout(gaps=True))


@pytest.mark.parametrize(("text", "message"), BAD)
def test_wrong_tables_are_named(tmp_path, text, message):
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=r"t\.csv") as error:
        read(path, M_PER_S)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_wrong_arrays_are_named(tmp_path):
    with pytest.raises(UserError, match="no such file"):
        read(tmp_path / "none.csv", M_PER_S)
    (tmp_path / "t.xlsx").write_text("")
    with pytest.raises(UserError, match=r"ending must be one of \.csv, \.nc, \.mat"):
        read(tmp_path / "t.xlsx", M_PER_S)
    xr.Dataset({"velocity": ("view", [1.0])}).to_netcdf(tmp_path / "t.nc", engine="netcdf4")
    with pytest.raises(UserError, match="direction_cosines is missing"):
        read(tmp_path / "t.nc", M_PER_S)
    group = example(np.random.default_rng(3)).to_dataset()
    group.to_netcdf(tmp_path / "u.nc", engine="netcdf4", auto_complex=True)
    with pytest.raises(UserError, match="states velocities in m/s"):
        read(tmp_path / "u.nc", VelocityUnit.mm_per_s)
    scipy.io.savemat(
        tmp_path / "t.mat", {"velocity": np.ones((3, 2)), "direction_cosines": np.eye(3)}
    )
    with pytest.raises(UserError, match="2 frequencies need an array frequency"):
        read(tmp_path / "t.mat", M_PER_S)
    (tmp_path / "v.mat").write_bytes(b"no matlab")
    with pytest.raises(UserError, match="not a readable MATLAB file"):
        read(tmp_path / "v.mat", M_PER_S)
