"""What a session kept is used again, for the same configuration and no other."""

from __future__ import annotations

import os
import shutil

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.config.paths import CONFIGURATION
from tests.plot.conftest import SMALL as DRAWN

# Two small views: fewer and shorter lines than the dissertation's, all circles.
SMALL = [
    "experiment=dissertation/automated_pose",
    "target=dissertation",
    "scan.coarse.pixels=180",
    "scan.fine.lines=12",
    "scan.sampling.samples=128",
    "scan.views={again: {dac: [[-142,-704],[-401,-1326],[673,-1632],[748,-646]]}}",
    "scene.views={again: {euler: [-1.153, 2.547, 1.913], origin: [0.862, 0.508, 1.553]}}",
    "~expect.truth",
    "~expect.residuals",
]


def variables(folder):
    with dataset.load(folder / "run.nc") as tree:
        return {
            f"{node.path}/{name}": np.asarray(values)
            for node in tree.subtree
            for name, values in node.data_vars.items()
        }


@pytest.fixture(scope="module")
def whole(run_once):
    return run_once(*SMALL)


def test_only_a_run_can_be_resumed(sldvexp, tmp_path):
    done = sldvexp(f"resume={tmp_path}")
    assert done.status == 1
    assert "is not the folder of a run" in done.err


@pytest.mark.whole
def test_a_recorded_session_is_replayed_to_the_bit(sldvexp, whole):
    small = [a for a in SMALL if not a.startswith("scene")]
    again = sldvexp(*small, "instrument=replay", f"instrument.path={whole}", "~scene")
    assert again.status == 0, again.err
    one, two = variables(whole), variables(again.folder)
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name], err_msg=name)
    other = sldvexp(*small, "instrument=replay", f"instrument.path={whole}", "~scene",
                    "scan.fine.lines=13")  # fmt: skip
    assert other.status == 1
    assert "a recording can only be scanned as it was" in other.err


@pytest.mark.whole
def test_scan_lines_of_another_seed_are_not_used(sldvexp, whole):
    before = {p: p.read_bytes() for p in whole.rglob("*") if p.is_file()}
    other = sldvexp(*SMALL, "seed=1", f"hydra.run.dir={whole}", "overwrite=true")
    assert other.status == 1
    assert "has scan lines of another configuration" in other.err
    assert before.items() <= {p: p.read_bytes() for p in whole.rglob("*") if p.is_file()}.items()


@pytest.mark.whole
@pytest.mark.parametrize("content", ["", "f00", None])
def test_a_digest_that_is_lost_is_unknown_and_not_another_configuration(
    sldvexp, whole, tmp_path, content
):
    """Lines that have this configuration's pixels and sampling are its own, and it is said."""
    folder = tmp_path / "cut"
    shutil.copytree(whole, folder)
    (folder / "run.nc").unlink()
    digest = folder / "journal" / CONFIGURATION
    right = digest.read_text()
    digest.unlink() if content is None else digest.write_text(content)
    lines = {p: p.stat().st_mtime_ns for p in folder.rglob("*.npz")}
    done = sldvexp(f"resume={folder}")
    assert done.status == 0, done.err
    assert "does not say any more which configuration" in (folder / "sldvexp.log").read_text()
    assert digest.read_text() == right
    assert {p: p.stat().st_mtime_ns for p in folder.rglob("*.npz")} == lines
    one, two = variables(whole), variables(folder)
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name], err_msg=name)


@pytest.mark.whole
def test_a_line_that_a_power_cut_emptied_is_measured_again(sldvexp, whole, tmp_path):
    folder = tmp_path / "cut"
    shutil.copytree(whole, folder)
    (folder / "run.nc").unlink()
    lines = sorted(folder.rglob("*.npz"))
    for line, size in zip(lines[3::20], (0, 100, 5000, 1), strict=False):
        os.truncate(line, min(size, line.stat().st_size - 1))
    assert sldvexp(f"resume={folder}").status == 0
    one, two = variables(whole), variables(folder)
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name], err_msg=name)


REPLAYED = [a for a in SMALL if not a.startswith("scene")]


@pytest.mark.whole
def test_a_replay_refuses_another_scene_and_takes_its_own(sldvexp, whole):
    """No setting of a scene changes lines that were scanned already."""
    replay = ("instrument=replay", f"instrument.path={whole}")
    other = sldvexp(*SMALL, *replay, "scene.vibrometer.noise=0.02")
    assert other.status == 1
    assert "were scanned in a scene with other settings" in other.err
    assert "~scene without any" in other.err
    same = sldvexp(*SMALL, *replay)
    assert same.status == 0, same.err
    notes = same.tree["verdict"]["text"].values
    assert not any("the scene is taken for what is true" in note for note in notes)


@pytest.mark.whole
def test_a_replay_says_what_a_scene_is_worth_that_the_lines_do_not_tell(sldvexp, whole, tmp_path):
    """As of lines that an instrument scanned: that is unknown, and no sign of another scene."""
    folder = tmp_path / "measured"
    shutil.copytree(whole, folder)
    digest = folder / "journal" / CONFIGURATION
    digest.write_text(digest.read_text().splitlines()[0])
    done = sldvexp(*SMALL, "instrument=replay", f"instrument.path={folder}")
    assert done.status == 0, done.err
    notes = done.tree["verdict"]["text"].values
    assert sum("the scene is taken for what is true" in note for note in notes) == 1


@pytest.mark.whole
def test_one_run_has_lines_of_one_source(sldvexp, whole, tmp_path):
    copy, folder = tmp_path / "copy", tmp_path / "run"
    shutil.copytree(whole, copy)
    replay = ("instrument=replay", f"instrument.path={whole}", "~scene")
    begun = sldvexp(*REPLAYED, *replay, f"hydra.run.dir={folder}")
    assert begun.status == 0, begun.err
    (folder / "run.nc").unlink()
    other = sldvexp(f"resume={folder}", f"instrument.path={copy}")
    assert other.status == 1
    *_, told = other.err.splitlines()  # before it, that the example has a view too
    assert f"has scan lines of instrument.path={whole}" in told
    assert f"instrument.path={copy} would be mixed with them" in told
    assert told.endswith(f"go on with instrument.path={whole}, or start the run in a new folder")
    assert sldvexp(f"resume={folder}", f"instrument.path={whole}").status == 0


def test_another_configuration_is_named_by_what_differs(sldvexp, run_once):
    drawn = run_once(*DRAWN)
    other = sldvexp(*DRAWN, "seed=1", "scan.calibration.fine.lines=13", f"hydra.run.dir={drawn}",
                    "overwrite=true")  # fmt: skip
    assert "another configuration (seed and scan differ)" in other.err
