"""Every importer of the registry keeps the contract of `sldvexp.importers.base`."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.config import registry
from sldvexp.errors import UserError
from sldvexp.importers import ImageImporter, Importer, PointImporter, PointwiseView, conventions
from sldvexp.instrument import ScanningPlugin

DATA = Path(__file__).parents[2] / "conf" / "data"
INSTRUMENTS = {name: registry.get("instrument", name) for name in registry.names("instrument")}
IMPORTERS = {name: cls for name, cls in INSTRUMENTS.items() if issubclass(cls, Importer)}

#: Files that cannot be read, by their content; None is none, and a folder is one.
WRONG = {
    "missing": None,
    "folder": "folder",
    "empty": b"",
    "binary": bytes(range(256)) * 16,
    "zeros": bytes(4096),
    "text": b"Dear colleague,\nplease find attached what we measured.\n",
    "cut netCDF": b"\x89HDF\r\n\x1a\n" + bytes(100),
    "cut universal file": b"    -1\n    58\nwords\n",
    "table without numbers": b"view,dx,dy,dz,real\na,b,c,d,e\n",
}


def of_file(cls, path):
    """An importer of one file: it has a path, or views that have one each."""
    names = {field.name for field in dataclasses.fields(cls)}
    if "path" in names:
        return cls(path=str(path))
    view = PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0])
    return cls(views={"front": view}, directions=conventions.Directions.view)


def work(importer):
    """Whatever the importer makes, as groups by their path."""
    if isinstance(importer, ImageImporter):
        return importer.images()
    return {"line_of_sight": importer.read()}


def test_instruments_scan_or_import():
    assert IMPORTERS
    for name, cls in INSTRUMENTS.items():
        assert issubclass(cls, ScanningPlugin | PointImporter | ImageImporter), name


@pytest.mark.one_in(5)
@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("name", IMPORTERS)
def test_wrong_file_is_refused_in_a_sentence_that_names_it(name, wrong, tmp_path):
    for suffix in (".csv", ".nc", ".mat", ".uff", ".txt"):
        path = tmp_path / f"mine{suffix}"
        if wrong == "folder":
            path.mkdir()
        elif WRONG[wrong] is not None:
            path.write_bytes(WRONG[wrong])
        importer = of_file(IMPORTERS[name], path)
        assert [Path(file).name for file in importer.inputs()] in ([path.name], ["run.nc"])
        with pytest.raises(UserError) as error:
            work(importer)
        assert str(path) in str(error.value)
        assert "\n" not in str(error.value)


def images(folder):
    """Two views of three pixels."""
    tree = {
        f"image/{view}": dataset.group(
            "image",
            {"frequency": [100.0, 200.0]},
            velocity=np.full((3, 2), 1e-3j),
            velocity_std=np.full((3, 2), 1e-6),
            dac=np.zeros((3, 2), int),
            flags=np.zeros(3, np.int8),
        )
        for view in ("front", "left")
    }
    xr.DataTree.from_dict(tree).to_netcdf(folder / "run.nc", engine="netcdf4", auto_complex=True)
    return IMPORTERS["images"](path=str(folder))


def said(**more):
    return {
        "positive": conventions.Positive.towards,
        "phase": conventions.Phase.exp_plus,
        "amplitude": conventions.Amplitude.peak,
        "directions": conventions.Directions.view,
        **more,
    }


def views(*names):
    return {
        name.rpartition(".")[0]: PointwiseView(path=str(DATA / name), direction=[0.0, 0.6, 0.8])
        for name in names
    }


#: An importer of each name with files that are right.
RIGHT = {
    "file": lambda _: IMPORTERS["file"](path=str(DATA / "point_example.csv")),
    "images": images,
    "scan_export": lambda _: IMPORTERS["scan_export"](views=views("scan_example.txt"), **said()),
    "uff": lambda _: IMPORTERS["uff"](
        views=views("tutorial_front.uff", "tutorial_left.uff"), **said(reference=1.0)
    ),
}


def test_every_importer_of_ours_is_tried_on_right_files():
    assert set(RIGHT) == {
        name for name, cls in IMPORTERS.items() if cls.__module__.startswith("sldvexp.")
    }


@pytest.mark.parametrize("name", RIGHT)
def test_right_file_becomes_groups_of_a_run(name, tmp_path):
    importer = RIGHT[name](tmp_path)
    assert all((Path.cwd() / file).exists() for file in importer.inputs())
    for path, group in work(importer).items():
        known = dataset.VARIABLES[path.partition("/")[0]]
        assert set(group.data_vars) <= set(known)
        for variable, array in group.data_vars.items():
            assert array.attrs["units"] == known[variable].units
        assert np.isfinite(group["velocity"]).all()
        assert np.iscomplexobj(group["velocity"])
        if "velocity_std" in group:
            assert (group["velocity_std"] > 0).all()
        if path == "line_of_sight":
            length = np.linalg.norm(group["direction_cosines"].transpose(..., "axis"), axis=-1)
            np.testing.assert_allclose(length, 1.0, atol=5e-3)
            told = {k for k in group.attrs if k.startswith("import_")}
            assert {"import_positive", "import_phase", "import_amplitude"} <= told | {
                "import_amplitude" if "import_reference" in told else ""
            }


@pytest.mark.parametrize("name", RIGHT)
def test_files_are_only_read(name, tmp_path):
    """A colleague's folder may be read-only: nothing is written beside a file."""
    before = sorted(DATA.iterdir())
    work(RIGHT[name](tmp_path))
    assert sorted(DATA.iterdir()) == before
    shutil.rmtree(tmp_path)  # and no file stays open
