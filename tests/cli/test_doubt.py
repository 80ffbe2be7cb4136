"""What a run in doubt says, and what is refused before anything is scanned."""

SPOILED = ("experiment=spoiled/sign", "scan.pixels=[13,15]")


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
