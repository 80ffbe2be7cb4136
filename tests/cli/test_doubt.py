"""What a run in doubt says, and what is refused before anything is scanned."""

import pytest

from sldvexp import dataset
from sldvexp.cli.rerun import AgreementLevel, compare

SPOILED = ("experiment=spoiled/sign", "scan.pixels=[13,15]")


@pytest.mark.whole
def test_stopped_run_says_that_it_stopped(sldvexp):
    done = sldvexp(*SPOILED, "on_doubt=stop")
    assert done.status == 2
    assert "verdict: void" in done.out
    assert "use_repair=[view_4.sign]" in done.out
    assert "stopped after the comparison of the views, as on_doubt=stop asks" in done.out
    assert "field" not in done.tree.children


def test_methods_that_disagree_on_pixels_are_refused_before_the_scan(sldvexp):
    done = sldvexp(*SPOILED, "+compare.other={plugin: absolute, robust: off}")
    assert done.status == 1
    assert "compare.other.robust: must be that of reconstruction, auto, not off" in done.err
    assert "the scan is kept" not in done.err


@pytest.mark.whole
def test_repaired_run_keeps_what_it_expects_and_repeats_to_the_bit(sldvexp):
    """What is expected of the mistake itself is not compared, which is said."""
    done = sldvexp(*SPOILED, "use_repair=[view_4.sign]", "pose.refine=images")
    assert done.status == 0, done.err
    assert "verdict: trusted" in done.out
    told = sldvexp("show", str(done.folder)).out
    assert "poses are refined by the images" in told
    assert "note: expected named and harm: not compared" in told
    again = sldvexp("rerun", str(done.folder))
    assert again.status == 0
    assert " 0 equal within rounding, 0 different" in again.out
    kept = (done.folder / "run.nc").rename(done.folder / "kept.nc")
    assert sldvexp(f"resume={done.folder}").status == 0
    with dataset.load(kept) as before, dataset.load(done.folder / "run.nc") as after:
        differences = compare(before.load(), after.load())
    assert {d.kind for d in differences} == {AgreementLevel.identical}
