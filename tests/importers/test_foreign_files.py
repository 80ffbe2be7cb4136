"""Files of others: other names, dimensions, conventions, and MATLAB 7.3."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io
import xarray as xr

from sldvexp.errors import ConfigError, UserError
from sldvexp.importers import conventions
from sldvexp.importers.velocity_file import File
from sldvexp.units import VelocityUnit

VIEWS, POINTS, FREQUENCIES = 3, 5, 2
MATLAB_73 = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: somewhere"


@pytest.fixture(scope="module")
def truth():
    rng = np.random.default_rng(5)
    d = rng.normal(size=(VIEWS, POINTS, 3))
    v = rng.normal(size=(2, VIEWS, POINTS, FREQUENCIES))
    return d / np.linalg.norm(d, axis=-1, keepdims=True), v[0] + 1j * v[1]


def right(path, truth, rtol=1e-15, **settings):
    group = File(path=str(path), **settings).read()
    np.testing.assert_allclose(group["direction_cosines"], truth[0], rtol=rtol)
    np.testing.assert_allclose(group["velocity"], truth[1], rtol=rtol)
    np.testing.assert_array_equal(group["frequency"], [10.0, 20.0])
    return group


def refused(path, said, **settings):
    with pytest.raises(UserError) as error:
        File(path=str(path), **settings).read()
    assert said in str(error.value), str(error.value)


MAPPING = {
    "head": "view",
    "node": "point",
    "nf": "frequency",
    "xyz": "axis",
    "D": "direction_cosines",
}


def foreign(truth, **variables):
    """A dataset with names, units and order of its own."""
    d, v = truth
    dims = ("nf", "node", "head")
    return xr.Dataset(
        {
            "D": (("node", "xyz", "head"), d.transpose(1, 2, 0)),
            "vr": (dims, v.real.T.copy().transpose(0, 1, 2), {"units": "m s-1"}),
            "vi": (dims, v.imag.T.copy()),
            "f": ("nf", [10.0, 20.0]),
            "heads": ("head", ["one", "two", "three"]),
            **variables,
        }
    )


@pytest.mark.one_in(2)
@pytest.mark.parametrize("form", ["NETCDF4", "NETCDF3_CLASSIC"])
def test_netcdf_of_others(truth, tmp_path, form):
    path = tmp_path / "other.nc"
    foreign(truth).to_netcdf(path, format=form, engine="netcdf4")
    mapping = MAPPING | {"vr": "real", "vi": "imag", "f": "frequency", "heads": "view"}
    group = right(path, truth, mapping=mapping)
    assert list(group["view"].values) == ["one", "two", "three"]
    refused(
        path,
        "instrument.mapping names vrr, which the file has not; did you mean vr?",
        mapping=mapping | {"vrr": "real"},
    )
    refused(path, "the variable direction_cosines is missing", mapping={"vr": "velocity"})
    refused(
        path,
        "the file states velocities in m s-1",
        mapping=mapping,
        unit=VelocityUnit.mm_per_s,
    )


WHOLE = MAPPING | {"vr": "real", "vi": "imag", "f": "frequency", "heads": "view"}
CUBE = ("nf", "node", "head")
EACH = np.ones((FREQUENCIES, POINTS, VIEWS))

#: Changes of the mapping, variables in the file, and what is said of them.
MISTAKES = {
    "components not named": (
        {"xyz": None},
        {},
        "D has the dimensions node (5), xyz (3), head (3); direction_cosines is over view, point, "
        "axis; say instrument.mapping={xyz: axis}",
    ),
    "several not named": (
        {"node": None, "xyz": None},
        {},
        "say which is which of axis, point with instrument.mapping={node: point, xyz: axis}",
    ),
    "needed ones first": (
        {"head": None, "heads": None, "xyz": None},
        {},
        "say which is which of view, axis with instrument.mapping={xyz: axis, head: view}",
    ),
    "a dimension as a variable": (
        {"head": "velocity", "heads": None},
        {},
        "calls head velocity, but it is a dimension, of length 3; a dimension is one of view, po",
    ),
    "a cube as a dimension": (
        {"vr": "axis"},
        {},
        "calls vr axis, but it has the dimensions nf (2), node (5), head (3); axis must be a dime",
    ),
    "views and points exchanged": (
        {"head": "point", "node": "view"},
        {},
        "calls heads view but its dimension head point; both must be one, as {heads: view, head: v",
    ),
    "two views": ({"node": "view"}, {}, "calls both "),
    "imaginary part alone": ({"vr": None}, {}, "has imag but not real, which instrument.mapping"),
    "whole and part": ({"vr": "velocity"}, {}, "has velocity and imag; instrument.mapping must"),
    "parts over different views": (
        {},
        {"vi": (CUBE[:2], EACH[..., 0])},
        "real has the dimensions frequency (2), point (5), view (3) but imag frequency (2), point",
    ),
    "parts in different units": (
        {},
        {"vi": (CUBE, EACH, {"units": "mm/s"})},
        "real is in m s-1 but imag in mm/s",
    ),
    "a dimension too many": (
        {},
        {v: ((*CUBE, "again"), np.ones((*EACH.shape, 4))) for v in ("vr", "vi")},
        "has the dimensions nf (2), node (5), head (3), again (4); velocity is over view, point, "
        "frequency; leave again out of the file",
    ),
    "no views": (
        {},
        {v: (CUBE[:2], EACH[..., 0]) for v in ("vr", "vi")},
        "velocity is over view, point, frequency, of which it lacks view",
    ),
    "four components and no name": (
        {"head": "view", "node": "point", "xyz": None},
        {"D": (("node", "four", "head"), np.ones((POINTS, 4, VIEWS)))},
        "is over view, point, axis; four cannot be axis, which has the length 3",
    ),
    "four components": (
        {},
        {"D": (("node", "four", "head"), np.ones((POINTS, 4, VIEWS)))},
        "direction_cosines has 4 components",
    ),
    "nothing of directions": (
        {"D": None},
        {},
        "direction_cosines is missing; needed are direction_cosines, velocity; there are D, of",
    ),
}


@pytest.mark.one_in(8)
@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_of_a_mapping(truth, tmp_path, name):
    changes, variables, said = MISTAKES[name]
    mapping = {k: v for k, v in (WHOLE | changes).items() if v is not None}
    if name == "four components":
        mapping = {"four" if k == "xyz" else k: v for k, v in mapping.items()}
    path = tmp_path / "other.nc"
    foreign(truth, **variables).to_netcdf(path, engine="netcdf4")
    refused(path, said, mapping=mapping)


#: Dimensions and their lengths, labels of some, and the mapping that is proposed.
REMEDIES = [
    ({"head": 3, "xyz": 3}, {}, "{head: view, xyz: axis}"),
    ({"xyz": 3, "head": 4}, {}, "{xyz: axis, head: view}"),
    ({"a": 4, "b": 3}, {}, "{a: , b: axis}"),
    ({"a": 3, "b": 3}, {"a": ["ux", "uy", "uz"]}, "{a: axis, b: }"),
    ({"node": 5, "head": 3, "component": 3}, {}, "{node: point, head: view, component: axis}"),
    ({"position": 4, "b": 5}, {}, "{position: , b: }"),
    ({"a": 4, "b": 5}, {}, "{a: , b: }"),
]


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("sizes", "labels", "proposed"), REMEDIES)
def test_the_mapping_that_is_proposed(tmp_path, sizes, labels, proposed):
    path = tmp_path / "other.nc"
    los = xr.DataArray(np.ones(list(sizes.values())), dims=list(sizes), coords=labels)
    xr.Dataset({"los": los, "velocity": ("view", np.ones(3))}).to_netcdf(path, engine="netcdf4")
    said = f"which is which of view, axis, point with instrument.mapping={proposed}"
    refused(path, said, mapping={"los": "direction_cosines"})


def test_dimensions_are_named_by_their_entries_too(truth, tmp_path):
    path = tmp_path / "other.nc"
    foreign(truth).to_netcdf(path, engine="netcdf4")
    right(path, truth, mapping={k: v for k, v in WHOLE.items() if k not in ("nf", "head")})


def test_components_by_their_names(truth, tmp_path):
    path = tmp_path / "other.nc"
    turned = truth[0].transpose(1, 2, 0)[:, [2, 0, 1]]
    data = foreign(truth, D=(("node", "xyz", "head"), turned), xyz=["uz", "ux", "uy"])
    data.to_netcdf(path, engine="netcdf4")
    right(path, truth, mapping=WHOLE)
    parts = {k: (("node", "head"), truth[0][..., i].T) for i, k in enumerate(("dx", "dy", "dz"))}
    foreign(truth, **parts).drop_vars("D").to_netcdf(path, engine="netcdf4")
    right(path, truth, mapping={k: v for k, v in WHOLE.items() if k not in ("D", "xyz")})


def test_standard_errors_that_stay_the_same_over_dimensions(truth, tmp_path):
    path = tmp_path / "other.nc"
    std = np.array([1e-3, 2e-3, 5e-3])
    foreign(truth, s=("head", std)).to_netcdf(path, engine="netcdf4")
    group = right(path, truth, mapping=WHOLE | {"s": "std"}, amplitude=conventions.Amplitude.peak)
    for i, expected in enumerate(std):
        np.testing.assert_array_equal(group["velocity_std"][i], np.full((5, 2), expected))


def test_group_of_a_netcdf_file(truth, tmp_path):
    path = tmp_path / "other.nc"
    data = foreign(truth, v=(("nf", "node", "head"), truth[1].T))
    xr.DataTree.from_dict({"/a/b": data}).to_netcdf(path, engine="netcdf4", auto_complex=True)
    mapping = MAPPING | {"v": "velocity", "f": "frequency"}
    right(path, truth, mapping=mapping, group="a/b")
    refused(path, "has no group c; there are a, a/b", mapping=mapping, group="c")


@pytest.mark.parametrize("version", ["5", "7.3"])
@pytest.mark.parametrize("order", [["view", "point", "frequency"], ["frequency", "view", "point"]])
def test_matlab_arrays(truth, tmp_path, version, order):
    axes = [["view", "point", "frequency"].index(name) for name in order]
    arrays = {
        "D": truth[0],
        "V": truth[1].transpose(axes),
        "frequency": np.array([[10.0, 20.0]]),
        "view": np.array(["one", "two", "three"]),
    }
    path = tmp_path / "arrays.mat"
    if version == "5":
        scipy.io.savemat(path, arrays)
    else:
        write_73(path, arrays)
    group = right(path, truth, mapping={"D": "direction_cosines", "V": "velocity"}, order=order)
    assert list(group["view"].values) == ["one", "two", "three"]
    refused(
        path,
        "velocity has 3 dimensions, but instrument.order says 2: view, frequency",
        mapping={"D": "direction_cosines", "V": "velocity"},
        order=["view", "frequency"],
    )
    refused(path, "the array direction_cosines is missing")


def write_73(path, arrays):
    """A MATLAB file of version 7.3: HDF5 after a block of 512 bytes, last dimension first."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            kind = "double"
            if array.dtype.kind == "U":
                kind = "char"
                width = max(map(len, array))
                array = np.array([[ord(c) for c in text.ljust(width)] for text in array], "u2")
            if array.dtype.kind == "c":
                pairs = np.empty(array.shape, [("real", "f8"), ("imag", "f8")])
                pairs["real"], pairs["imag"] = array.real, array.imag
                array = pairs
            made = file.create_dataset(name, data=array.T)
            made.attrs["MATLAB_class"] = np.bytes_(kind)
    with path.open("r+b") as file:
        file.write(MATLAB_73.ljust(124) + b"\0\2IM")


def test_a_damaged_matlab_file(tmp_path):
    path = tmp_path / "damaged.mat"
    path.write_bytes(MATLAB_73.ljust(124) + b"\0\2IM" + bytes(2000))
    refused(path, "is not a readable MATLAB 7.3 file")


def test_columns_with_other_names(tmp_path):
    path = tmp_path / "other.csv"
    path.write_text("Ansicht,nx,ny,nz,Re,Im\na,1,0,0,1,2\nb,0,1,0,3,-4\n")
    mapping = {"Ansicht": "view", "nx": "dx", "ny": "dy", "nz": "dz", "Re": "real", "Im": "imag"}
    group = File(path=str(path), mapping=mapping).read()
    np.testing.assert_array_equal(group["velocity"], [1 + 2j, 3 - 4j])
    assert list(group["view"].values) == ["a", "b"]


def test_conventions_are_applied_and_recorded(tmp_path):
    path = tmp_path / "signs.csv"
    path.write_text("view,dx,dy,dz,real,imag,std\na,1,0,0,1,2,0.5\n")
    group = File(
        path=str(path),
        positive=conventions.Positive.away,
        phase=conventions.Phase.exp_minus,
        amplitude=conventions.Amplitude.rms,
    ).read()
    np.testing.assert_allclose(group["velocity"], [2**0.5 * (-1 + 2j)])
    np.testing.assert_allclose(group["velocity_std"], [2**0.5 * 0.5])
    assert (group.attrs["import_positive"], group.attrs["import_phase"]) == ("away", "exp_minus")
    assert group["velocity"].attrs["units"] == group["velocity_std"].attrs["units"] == "m/s"


def test_a_mapping_the_wrong_way_round():
    with pytest.raises(ConfigError) as error:
        File(path="x.nc", mapping={"axis": "component"})
    assert "the file's name comes first: write {component: axis}" in str(error.value)


@pytest.mark.parametrize(
    "wrong", [{"mapping": {"v": "speed"}}, {"order": ["point"]}, {"order": ["view"] * 2}]
)
def test_settings_that_cannot_be(wrong):
    with pytest.raises(ConfigError):
        File(path="x.csv", **wrong)
