"""Bounds of every experiment that knows the truth hold as often as they say, in every component."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sldvexp.limits import load_yaml

FOLDER = Path(__file__).parents[2] / "conf" / "experiment"
#: By how much the share of intervals that hold the truth may differ from what is stated.
ALLOWED = 0.02
FEW_LINES = "{frequency: [100.0,195.0,300.0,440.0,600.0,785.0,1000.0,1200.0]}"
SMALL = {
    "curved_panel": ["scan.pixels=[21,25]", "volume.shape=[23,18]"],
    "plate_frf": [
        "scan.pixels=[17,19]",
        "volume.shape=[14,12]",
        f"scan.sampling={FEW_LINES}",
        "~expect.resonances",
    ],
}


def knows_the_truth(path: Path) -> bool:
    text = path.read_text()
    checks = load_yaml(text).get("check") or {} if "plugin: truth" in text else {}
    return any(check.get("plugin") == "truth" for check in checks.values() if check)


KNOWING = sorted(
    str(p.relative_to(FOLDER).with_suffix("")) for p in FOLDER.rglob("*.yaml") if knows_the_truth(p)
)


def covered(sldvexp, name, seeds, *settings):
    """Shares of every session and component, shape (seed, component)."""
    found = []
    for seed in range(seeds):
        done = sldvexp(f"experiment={name}", f"seed={seed}", "report=none", *settings)
        # What is expected of the experiment as it is may be missed by a small one.
        assert done.status in (0, 2), done.err
        check = "samplewise" if "samplewise" in done.tree["examined"].children else "truth"
        found.append(done.tree[f"examined/{check}"]["covered_in_all"].values)
    return np.array(found)


def test_these_experiments_know_the_truth():
    assert set(KNOWING) >= {"curved_panel", "plate", "plate_frf"}


@pytest.mark.whole
@pytest.mark.parametrize("name", SMALL)
def test_bounds_hold_in_some_small_sessions(name, sldvexp):
    """Nodes of a session share pixels: its share is one draw, whose spread the sessions tell."""
    seeds = 5
    shares = covered(sldvexp, name, seeds, *SMALL[name])
    chance = 3 * shares.std(axis=0, ddof=1) / np.sqrt(seeds)
    assert np.all(chance < 0.04)
    assert np.all(np.abs(shares.mean(axis=0) - 0.95) <= ALLOWED + chance)


@pytest.mark.long
@pytest.mark.parametrize("name", KNOWING)
def test_bounds_hold_in_fifty_sessions(name, sldvexp):
    shares = covered(sldvexp, name, 50)
    print(name, shares.mean(axis=0), shares.std(axis=0, ddof=1) / np.sqrt(50))
    assert np.all(np.abs(shares.mean(axis=0) - 0.95) <= ALLOWED)
