"""The contract of `sldvexp.check.base`, kept by every check of the registry."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.check import Examination
from sldvexp.config import registry
from sldvexp.dataset import VARIABLES, open_run
from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose
from sldvexp.plot.selection import plugin
from sldvexp.shell import Gage

SMALL = [
    *("report=none", "pose=bitangent", "~scan.calibration.views.5", "~scan.structure.views.5"),
    *(f"scan.{part}.sampling.samples=256" for part in ("calibration", "structure")),
    *("scan.calibration.fine.lines=16", "scan.structure.pixels=[9,11]"),
    *("volume.shape=[7,6]", "volume.layers=3"),
]
#: Nothing of a run, only these settings.
SETTINGS_ONLY = {"cross_ratio"}
LINE = [[0.0, y, 1.0] for y in (-0.2, 0.0, 0.1, 0.3)]
OTHER = {v: KnownPose([0.0, 3.0, 0.0], [0.0, 0.0, 1.7], [0.1] * 3, [0.1] * 3, 16) for v in "1234"}
#: Settings that a check needs, by its name; any other is made as it is.
SETTINGS = {
    "cross_ratio": {
        "up_down_points": LINE,
        "left_right_points": [[y, x, z] for x, y, z in LINE],
    },
    "equivalent_methods": {"other": "compare/three"},
    "gages": {
        "gages": {"small": Gage(place=[0.02, -0.03])},
        "path": "conf://data/gages_example.csv",
    },
    "pose_equivalence": {"views": OTHER},
    "pose_methods": {"methods": {"bitangent": "pose"}},
    "pose_repeats": {"repeats": 10},
}

#: Two of the plate's modes, in a run of too few lines to find any.
MODES = dataset.group(
    "modes",
    {"mode": [1, 2], "line": [0, 1]},
    natural_frequency=[197.0, 439.01],
    natural_frequency_std=[0.01, 0.02],
    damping_ratio=[0.01, 0.0099],
    damping_ratio_std=[1e-4, 1e-4],
    scale_std=[1e-3, 1e-3],
    phase_std=[1e-3, 1e-3],
    line_frequency=[100.0, 500.0],
)

each_check = pytest.mark.parametrize("name", registry.names("check"))


def made(name):
    return registry.get("check", name)(**SETTINGS.get(name, {}))


@pytest.fixture(scope="module")
def run(run_once) -> dataset.RunData:
    """A small session, and a point besides."""
    point = ["experiment=point", "report=none", "compare={three: {plugin: combined}}"]
    session = dataset.RunData.from_source(open_run(run_once(*SMALL)))
    del session.groups["compare/samplewise"]  # no field among points
    points = open_run(run_once(*point))
    for one in ("point", "line_of_sight", "compare/three"):
        session.groups[one] = points[one].to_dataset()
    session.groups["modes"] = MODES
    return session


@pytest.fixture
def examination(run):
    groups = {name: group.copy(deep=True) for name, group in run.groups.items()}
    needed = ("laser", "target", "volume", "reconstruction", "solver", "material", "scene", "scan")
    used = {g: plugin(run, g, "check") for g in needed} | {"compare": {}, "seed": 0}
    return Examination(groups, rng=np.random.default_rng(0), experiment=SimpleNamespace(**used))


@pytest.mark.whole
@each_check
def test_a_check_finds_the_variables_that_are_known_of_it(name, examination, tmp_path):
    found = made(name).examine(examination)
    known = VARIABLES[f"examined/{name}"]
    assert found.data_vars
    for variable, values in found.data_vars.items():
        facts = known[variable]
        assert values.attrs["units"] == facts.units
        assert values.attrs["long_name"] == facts.long_name
    assert isinstance(found.attrs.get("notes", ""), str)
    dataset.save({f"examined/{name}": found}, {}, tmp_path / "run.nc")
    assert open_run(tmp_path)[f"examined/{name}"].to_dataset().identical(found)


@pytest.mark.whole
@each_check
def test_a_check_changes_nothing_and_draws_from_the_runs_generator_alone(name, run, examination):
    first = made(name).examine(examination)
    assert list(examination.groups) == list(run.groups)
    assert all(group.identical(run.groups[k]) for k, group in examination.groups.items())
    again = Examination(
        examination.groups, rng=np.random.default_rng(0), experiment=examination.experiment
    )
    assert made(name).examine(again).identical(first)


@each_check
def test_a_check_says_in_a_sentence_what_it_lacks(name):
    nothing = Examination({}, rng=np.random.default_rng(0))
    if name in SETTINGS_ONLY:
        assert made(name).examine(nothing).data_vars
        return
    with pytest.raises(UserError) as raised:
        made(name).examine(nothing)
    assert len(str(raised.value).splitlines()) == 1


@each_check
def test_a_check_names_its_files(name):
    assert all(isinstance(file, str) for file in made(name).inputs())
