"""Table 5.7 in two runs, and one sweep over all methods: columns by method and by experiment."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml

from sldvexp.sweep.collect import headlines

#: Its methods are one after another in a sweep here, instead of beside one another.
EXPERIMENT = Path(__file__).parents[2] / "conf/experiment/dissertation/table_5_7_2.yaml"
METHODS = ("absolute", "absolute_full", "relative", "combined", "contravariant")
EVERY = f"reconstruction={','.join(METHODS)}"
WHERE = "hydra.sweep.dir=swept"
#: Two layers of 3 x 3 nodes: 8 prisms of 6 samples.
SMALL = ("volume=grid", "volume.shape=[3,3]", "volume.layers=2", "scan.pixels=[9,11]")
NODES, SAMPLES, VIEWS = 18, 48, 5
COLUMNS = ("unknowns", "rows", "residual std", "SSE", "cond", "std in plane", "out of plane")
#: Nodal dof, sample points and condition number of both experiments as printed.
PRINTED = {
    "field": (1323, 19950, [7977, 1.336e4]),
    "compare.full": (1764, 19950, [2.1326e6, 3.8586e6]),
    "compare.relative": (1323, 15960, [5504, 5107]),
    "compare.contravariant": (441, 7980, [245, 245]),
}


def opened(folder) -> xr.Dataset:
    with xr.open_dataset(folder / "sweep.nc", engine="netcdf4") as table:
        return table.load()


def lines(out: str) -> list[list[str]]:
    """Cells of the ranking's rows."""
    split = [line.split("│")[1:-1] for line in out.splitlines() if line.startswith("│")]
    return [[cell.strip() for cell in row] for row in split if row[0].strip()]


@pytest.mark.long
def test_all_methods_of_the_table(sldvexp, tmp_path):
    text = yaml.safe_load(EXPERIMENT.read_text())
    alone = [f"~{key}.{name}" for key in ("compare", "check", "expect") for name in text[key]]
    done = sldvexp("-m", "experiment=dissertation/table_5_7_2", EVERY, *SMALL, *alone, WHERE)
    assert done.status == 0, done.err + done.out
    table = opened(tmp_path / "swept")

    # Counts by method, each labelled.
    assert table["reconstruction"].values.tolist() == list(METHODS)
    assert (table["state"] == "done").all()
    unknowns = [3 * NODES, 4 * NODES, 3 * NODES, 3 * NODES, NODES]
    assert table["field.dof"].values.tolist() == unknowns
    rows = np.array([VIEWS, VIEWS, VIEWS - 1, 3, 2]) * SAMPLES
    assert table["field.samples"].values.tolist() == rows.tolist()
    assert table["field.residual_std_by_view"].dims == ("reconstruction", "view", "frequency")
    assert table["field.residual_std_by_view"]["view"].values.tolist() == list("12345")

    # Cont. X, Y and Z stand by themselves, and add up to the pooled figure.
    sums = table["field.sse_by_equation"]
    assert sums.dims == ("reconstruction", "equation")
    three = sums.sel(reconstruction="contravariant", equation=["x", "y", "z"])
    pooled = table["field.sse"].sel(reconstruction="contravariant")
    assert float(three.sum()) == pytest.approx(float(pooled), rel=1e-12)
    single = sums.sel(reconstruction="absolute")
    assert np.isnan(single.sel(equation=["x", "y", "z"])).all()
    assert float(single.sel(equation="all components")) == pytest.approx(
        float(table["field.sse"].sel(reconstruction="absolute")), rel=1e-12
    )

    # Its findings: the decoupled matrix is the best conditioned, the plane the worst determined.
    cond = table["field.cond"]
    by_cond = cond.to_series().sort_values().index
    assert (by_cond[0], by_cond[-1]) == ("contravariant", "absolute_full")
    assert ((table["field.rcond"] > 0) & (table["field.rcond"] < 1 / cond)).all()  # of other norms
    for method in ("absolute", "combined", "contravariant"):
        one = table.sel(reconstruction=method)
        assert one["field.std_in_plane"] > 2 * one["field.std_out_of_plane"]
    assert table["field.std_in_plane"].attrs["units"] == "m/s"

    # The ranking has all of it, the smallest residuals first.
    header = done.out[done.out.index("5 runs by field.residual_std") :]
    assert all(word in " ".join(header.split()) for column in COLUMNS for word in column.split())
    ranked = lines(done.out)
    best = table["field.residual_std"].to_series().sort_values().index.tolist()
    assert [row[1] for row in ranked] == best
    assert [int(row[2]) for row in ranked] == [unknowns[METHODS.index(m)] for m in best]
    in_plane = [float(row[7]) for row in ranked]
    expected = 1000 * table["field.std_in_plane"].sel(reconstruction=best)
    np.testing.assert_allclose(in_plane, expected, rtol=1e-3)
    with (tmp_path / "swept" / "sweep.csv").open(newline="") as file:
        written = {row["reconstruction"]: row for row in csv.DictReader(file)}
    assert float(written["contravariant"]["field.sse_by_equation[equation=z]"]) > 0


def field(**stds) -> dict[str, xr.Dataset]:
    """A field of two nodes, with the standard errors of its components."""
    values = np.array(list(stds.values()))[None, :, None] * np.array([1, 7])[:, None, None]
    dims = ("node", "component", "frequency")
    group = xr.Dataset({"velocity_std": (dims, values)}, {"component": list(stds)})
    return {"field": group, "compare/other": group.assign_coords(element=0)}


@pytest.mark.parametrize("names", [("x", "y", "z"), ("t1", "t2", "n")])
def test_standard_errors_in_the_surface_and_out_of_it(names):
    """Root mean squares: of 1 and 7 it is 5, of 3 and 4 in both directions sqrt(12.5)."""
    found = headlines(field(**dict(zip(names, (3.0, 4.0, 0.5), strict=True))))
    for of in ("field", "compare.other"):
        assert float(found[f"{of}.std_in_plane"]) == pytest.approx(5 * 12.5**0.5, rel=1e-12)
        assert float(found[f"{of}.std_out_of_plane"]) == pytest.approx(2.5, rel=1e-12)


def test_what_is_not_determined_has_no_part():
    groups = field(x=3.0, y=4.0, z=0.5)
    std = groups["field"]["velocity_std"]
    groups["field"]["velocity_std"] = std.where(std != 3.0)
    found = headlines(groups)
    expected = np.sqrt((21.0**2 + 4.0**2 + 28.0**2) / 3)
    assert float(found["field.std_in_plane"]) == pytest.approx(expected, rel=1e-12)


@pytest.mark.one_in(12)
@pytest.mark.parametrize(
    ("experiment", "method"),
    [
        *(("plate", method) for method in METHODS),
        ("curved_panel", "combined"),
        ("plate_frf", "combined"),
    ],
)
def test_fields_take_every_method(experiment, method, sldvexp):
    """No experiment asks for rows that another method than its own does not have."""
    done = sldvexp(f"experiment={experiment}", f"reconstruction={method}", "seed=-1")
    assert done.err == "sldvexp: command line: seed must be zero or a positive integer, not -1\n"


@pytest.mark.long
def test_the_whole_table(sldvexp, tmp_path):
    both = "experiment=dissertation/table_5_7_1,dissertation/table_5_7_2"
    done = sldvexp("-m", both, WHERE)
    assert done.status == 0, done.err + done.out
    table = opened(tmp_path / "swept")
    assert table["state"].dims == ("experiment",)
    for method, (dof, rows, cond) in PRINTED.items():
        assert table[f"{method}.dof"].values.tolist() == [dof, dof]
        assert table[f"{method}.samples"].values.tolist() == [rows, rows]
        # Poses and nodes are others than the print's, and the size of the numbers is the same.
        ratio = table[f"{method}.cond"] / np.array(cond)
        np.testing.assert_allclose(ratio, 1, atol=0.4)
    better = table["compare.relative.cond"] / table["field.cond"]
    assert (better > 0.3).all()
    assert (better < 0.8).all()
    for of in ("field", "compare.relative", "compare.contravariant"):
        assert (table[f"{of}.std_in_plane"] > 2 * table[f"{of}.std_out_of_plane"]).all()


@pytest.mark.long
def test_the_printed_count_of_samples_rejects_what_is_true(sldvexp):
    """Exact poses, no intercept, and a field that the elements follow; 2.5 +- 0.2 over seeds."""
    done = sldvexp(
        *("experiment=dissertation/table_5_7_2", "report=none"),
        "pose.views.1.euler=[0.024,2.910,-3.117]",
        *("scan.sampling.frequency=[330.0]", "scan.sampling.amplitude=0.15"),
    )
    assert not done.err  # another motion misses what the experiment expects
    found = done.tree["examined/printed"].to_dataset()
    assert found["f_statistic"].item() == pytest.approx(2.5, abs=0.8)
    assert found["f_statistic"].item() > 1.3 * found["f_critical"].item()
