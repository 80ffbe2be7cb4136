"""What an addition edits: each is made in a copy of the package, and used there.

The tables of files are the promise of `.github/CONTRIBUTING.md`: a group of the configuration takes
three, a plugin of any group two.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
EXPERIMENT = "sldvexp/config/experiment.py"


def line_of(group: str, name: str, module: str):
    """Add a plugin to a group's table in the root of the configuration."""

    def edit(text: str) -> str:
        start = rf'((?:one_of|several_of)\(\s*"{group}",\s*\{{)'
        assert len(re.findall(start, text)) == 1
        return re.sub(start, rf'\1"{name}": "{module}", ', text)

    return edit


def field(line: str):
    """Add a field to the root of the configuration."""
    return lambda text: text.replace("    overwrite: bool", f"    {line}\n    overwrite: bool", 1)


class Addition(NamedTuple):
    """Files that are edited or written, what is run then, and what it prints."""

    files: dict[str, object]
    run: str
    prints: str


POSE = '''
"""`pose=above`: straight above the origin, for the test of additions."""

from dataclasses import dataclass

import numpy as np

from sldvexp.config.registry import register
from sldvexp.pose import PoseMethod, PoseResult, pose_to_dataset


@register("pose", "above")
@dataclass
class Above(PoseMethod):
    """The instrument stands at a height above the origin.

    Parameters
    ----------
    height : float, m
    """

    height: float = 2.0

    def estimate(self, laser, target, tree):
        """See `PoseMethod`."""
        down = np.diag([1.0, -1.0, -1.0])
        known = np.eye(6)[None] * 1e-8
        found = pose_to_dataset(
            ["only"], down[None], [[0, 0, self.height]], known, [np.inf], 0.95
        )
        return PoseResult(found)
'''
ESTIMATOR = '''
"""`signal=doubled`: twice what the sines say, for the test of additions."""

from dataclasses import dataclass, replace

from sldvexp.config.registry import register
from sldvexp.signal import SignalEstimator
from sldvexp.signal import SineFit


@register("signal", "doubled")
@dataclass
class Doubled(SignalEstimator):
    """Twice the velocity."""

    def demodulate(self, samples, times, frequencies, **others):
        """See `SignalEstimator`."""
        image = SineFit().demodulate(samples, times, frequencies, **others)
        return replace(image, velocity=2 * image.velocity)
'''
CHECK = '''
"""`check=counted`: how many groups a run has, for the test of additions."""

from dataclasses import dataclass

import xarray as xr

from sldvexp.check import Check
from sldvexp.config.registry import register


@register("check", "counted")
@dataclass
class Counted(Check):
    """The number of groups."""

    def examine(self, run):
        """See `Check`."""
        return xr.Dataset({"groups": ((), len(run.groups), {"units": "1", "long_name": "groups"})})
'''
EXPORT = '''
"""`export=names`: the names of a run's groups, for the test of additions."""

from dataclasses import dataclass

from sldvexp.config.registry import register
from sldvexp.export import Export


@register("export", "names")
@dataclass
class Names(Export):
    """The names of the groups as text."""

    suffix = ".txt"

    def write(self, run, path):
        """See `Export`."""
        path.write_text(" ".join(run.groups))
'''
IMPORTER = '''
"""`instrument=constant`: three views of one point, for the test of additions."""

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.config.registry import register
from sldvexp.importers import PointImporter


@register("instrument", "constant")
@dataclass
class Constant(PointImporter):
    """The same velocity along three axes."""

    velocity: float = 0.25

    def inputs(self):
        """See `PointImporter`."""
        return []

    def read(self, tree=None, laser=None):
        """See `PointImporter`."""
        return dataset.group(
            "line_of_sight",
            {"view": ["a", "b", "c"]},
            direction_cosines=np.eye(3),
            velocity=np.full(3, self.velocity),
        )
'''
MATERIAL = '''
"""`material=isotropic`: of what the part is made, for the test of additions."""

from dataclasses import dataclass

from sldvexp.config.registry import register
from sldvexp.errors import Checks


@register("material", "isotropic")
@dataclass
class Isotropic:
    """A material alike in all directions.

    Parameters
    ----------
    poisson : float
        Ratio of contraction across to strain along.
    """

    poisson: float = 0.3

    def __post_init__(self):
        checks = Checks()
        checks.require(-1 < self.poisson < 0.5, "poisson", "must lie between -1 and 0.5")
        checks.done()
'''

ADDITIONS = {
    "a group of the configuration": Addition(
        {
            EXPERIMENT: field(
                'material: Any = one_of("material", {"isotropic": "sldvexp.targets.isotropic"})'
            ),
            "sldvexp/targets/isotropic.py": MATERIAL,
            "conf/material/rubber.yaml": (
                "# Rubber.\ndefaults:\n  - schema/isotropic@_here_\n  - _self_\npoisson: 0.49\n"
            ),
        },
        "sldvexp.run('experiment=point', 'report=none', 'material=rubber');"
        "main('list', 'material'); main('~experiment', 'material=rubber', 'material.poisson=0.7')",
        "material=rubber.*must lie between -1 and 0.5",
    ),
    "a pose method": Addition(
        {EXPERIMENT: line_of("pose", "above", "sldvexp.pose.above"), "sldvexp/pose/above.py": POSE},
        "tree = sldvexp.run('~experiment', 'pose=above', 'pose.height=3', 'report=none');"
        "print(tree['pose/origin'].values)",
        r"\[\[0. 0. 3.\]\]",
    ),
    "a signal estimator": Addition(
        {
            EXPERIMENT: line_of("signal", "doubled", "sldvexp.signal.doubled"),
            "sldvexp/signal/doubled.py": ESTIMATOR,
        },
        "import numpy as np; from sldvexp.config import registry; times = np.arange(64) / 640;"
        "wave = np.cos(2 * np.pi * 50 * times);"
        "found = registry.get('signal', 'doubled')().demodulate([[wave, wave]], times, [50]);"
        "print(found.velocity.real.round(4)); main('list', 'signal')",
        r"\[\[0.02\]\].*doubled",
    ),
    "a check": Addition(
        {
            EXPERIMENT: line_of("check", "counted", "sldvexp.check.counted"),
            "sldvexp/check/counted.py": CHECK,
        },
        "tree = sldvexp.run('experiment=point', 'check.n.plugin=counted', 'report=none');"
        "print(int(tree['examined/n/groups']))",
        r"\n3\n",
    ),
    "an export": Addition(
        {
            EXPERIMENT: line_of("export", "names", "sldvexp.export.names"),
            "sldvexp/export/names.py": EXPORT,
        },
        "sldvexp.run('experiment=point', 'export.n.plugin=names', 'report=none', "
        "'hydra.run.dir=here'); print(open('here/n.txt').read())",
        "line_of_sight point",
    ),
    "an importer": Addition(
        {
            EXPERIMENT: line_of("instrument", "constant", "sldvexp.importers.constant"),
            "sldvexp/importers/constant.py": IMPORTER,
        },
        "tree = sldvexp.run('~experiment', 'instrument=constant', 'reconstruction=absolute', "
        "'report=none'); print(tree['point/velocity'].values.real)",
        r"\[0.25 0.25 0.25\]",
    ),
}
START = """
import contextlib, io, sys
import sldvexp
from sldvexp.cli.main import main as command
def main(*arguments):
    sys.argv[1:] = arguments
    with contextlib.suppress(SystemExit), contextlib.redirect_stderr(sys.stdout):
        command()
"""


@pytest.mark.whole
@pytest.mark.parametrize("name", ADDITIONS)
def test_an_addition_edits_no_more_than_its_files(name, tmp_path):
    files, run, prints = ADDITIONS[name]
    assert len(files) == (3 if "group" in name else 2)
    copy, work = tmp_path / "copy", tmp_path / "work"
    work.mkdir()
    for folder in ("sldvexp", "conf"):
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for file, edit in files.items():
        path = copy / file
        path.parent.mkdir(exist_ok=True)
        path.write_text(edit(path.read_text()) if callable(edit) else str(edit))
    done = subprocess.run(
        [sys.executable, "-c", f"{START}\n{run}"],
        cwd=work,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(prints, done.stdout, re.DOTALL), done.stdout
