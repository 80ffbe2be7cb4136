"""Whole sessions of the virtual lab whose images have drop-outs or a hole, next to clean ones.

`measure` scans a plate, examines the images and makes the field, as the command does. The same seed
without drop-outs and hole is the session that it is compared with: its noise is the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from sldvexp.check.truth import Columns
from sldvexp.dataset import findings_of
from sldvexp.field.estimate import volume_visibility
from sldvexp.pipeline.step import Run
from sldvexp.pipeline.steps import SCAN, STEPS, VOLUME
from sldvexp.signal import Flag
from sldvexp.virtual_lab.plate import Hole, VibratingPlate
from tests.composing import experiment

STEP = {step.name: step for step in STEPS}
#: Nodes of the volume of 26 cm by 21 cm, by about how long its elements are, mm.
NODES = {15: [18, 15], 25: [11, 9], 50: [6, 5]}
SHARES = [0.002, 0.01, 0.05, 0.1]
#: Standard deviation of the share of one session's intervals that hold the truth, by twelve.
ONE = 0.01
#: 4 cm by 4 cm; nodes of all these volumes are in it.
HOLE = Hole(center=[0.03, 0.01], size=[0.04, 0.04])


@dataclass
class Measured:
    """One session.

    Attributes
    ----------
    square : ndarray, shape (component,), m2/s2
        Mean square error at the columns of nodes that both sessions know, outside of the hole.
    clean : ndarray, shape (component,), m2/s2
        That of the clean session.
    covered : ndarray, shape (component,)
        Share of the intervals outside of the hole that hold the truth.
    lost, good : int
        Good pixels that were left out, of how many.
    kept, bad : int
        Bad ones that weigh a hundredth or more in any sample, of how many.
    known_in_hole, in_hole, blank : int
        Columns in the hole that have a velocity, of how many; others that have none.
    holes : list of str
        Findings about holes.
    """

    square: np.ndarray
    clean: np.ndarray
    covered: np.ndarray
    lost: int
    good: int
    kept: int
    bad: int
    known_in_hole: int
    in_hole: int
    blank: int
    holes: list[str]


@cache
def unspoiled():
    return experiment("experiment=spoiled/clean", "expect={}")


def spoiled(seed, share, hole):
    e = unspoiled()
    vibrometer = replace(e.scene.vibrometer, unflagged=share)
    plate = replace(e.scene.plate, holes={"one": HOLE} if hole else {})
    return replace(e, seed=seed, scene=replace(e.scene, vibrometer=vibrometer, plate=plate))


def done(e, names, tree=()):
    with TemporaryDirectory() as folder:
        run = Run(e, np.random.default_rng(e.seed), Path(folder), tree=dict(tree))
        for name in names:
            STEP[name].perform(run)
        return run.tree


@cache
def scanned(seed, share, hole):
    return done(spoiled(seed, share, hole), [SCAN, "pose"])


@cache
def reconstructed(seed, share, hole, elements):
    """Groups of a session; error and bounds (part first) where columns of nodes cross the plate."""
    e = spoiled(seed, share, hole)
    e = replace(e, volume=replace(e.volume, shape=NODES[elements]))
    names = [VOLUME, "comparison of the views", "velocity field"]
    tree = done(e, names, scanned(seed, share, hole))
    field, plate = tree["field"], VibratingPlate.built(unspoiled().scene.plate)
    place, tones = field["position"].values, field["frequency"].values
    columns = Columns.from_volume(tree["volume"], plate.height(place))
    truth = np.stack([plate.velocity(place, f) for f in tones], axis=-1)
    error = columns.at_surface(field["velocity"].values - truth)
    bounds = field["confidence_by_part"].transpose("part", *field["velocity"].dims).values
    return (
        tree,
        np.stack([error.real, error.imag]),
        np.stack([columns.at_surface(part) for part in bounds]),
        columns.at_surface(place) - plate.center,
    )


def in_hole(place):
    return np.all(np.abs(place[:, :2] - HOLE.center) < np.array(HOLE.size) / 2, axis=1)


def measure(seed, elements, share=0.0, hole=False):
    tree, error, bound, place = reconstructed(seed, share, hole, elements)
    _, clean, _, _ = reconstructed(seed, 0.0, False, elements)
    inside = in_hole(place) if hole else np.zeros(len(place), bool)
    known = np.isfinite(error).all(axis=(0, 2, 3))
    outside = known & ~inside
    lost, good, kept, bad = pixels(seed, elements, share, hole, tree)
    return Measured(
        square=2 * np.mean(error[:, outside] ** 2, axis=(0, 1, 3)),
        clean=2 * np.mean(clean[:, outside] ** 2, axis=(0, 1, 3)),
        covered=np.mean(np.abs(error[:, outside]) <= bound[:, outside], axis=(0, 1, 3)),
        lost=int(lost),
        good=int(good),
        kept=int(kept),
        bad=int(bad),
        known_in_hole=int(np.sum(known & inside)),
        in_hole=int(inside.sum()),
        blank=int(np.sum(~known & ~inside)),
        holes=[f.text for f in findings_of(tree) if f.kind == "hole"],
    )


def pixels(seed, elements, share, hole, tree):
    """Count good pixels left out, good ones, bad ones that samples use, and bad ones."""
    e, counted = unspoiled(), np.zeros(4, int)
    volume = replace(e.volume, shape=NODES[elements])
    visibility = volume_visibility(tree, e.laser, volume)
    samples = visibility.at(visibility.triangles).by_view
    for name, of in zip(visibility.names, samples, strict=True):
        image, clean = (scanned(seed, *how)[f"image/{name}"] for how in ((share, hole), (0, False)))
        there = image["flags"].values == 0
        off = np.abs(image["velocity"].values - clean["velocity"].values).max(axis=1) > 1e-12
        used = np.abs(of.weights).max(axis=0).toarray() >= 0.01
        left_out = tree[f"image/{name}"]["flags"].values & (Flag.unlike | Flag.resting) != 0
        good, bad = there & ~off, there & off
        counted += [np.sum(k) for k in (good & left_out, good, bad & used, bad)]
    return counted.tolist()


def relative_error(sessions):
    """Root mean square error of all sessions and components over that of the clean ones."""
    square, clean = (np.sum([getattr(s, of) for s in sessions]) for of in ("square", "clean"))
    return float(np.sqrt(square / clean))


def assert_kept(sessions, chance):
    """Hold sessions to what is asked of them; `chance` is that of their share of intervals."""
    assert relative_error(sessions) <= 1.1
    assert abs(np.mean([s.covered for s in sessions]) - 0.95) <= 0.02 + chance
    assert sum(s.lost for s in sessions) <= 1e-3 * sum(s.good for s in sessions)
    assert sum(s.kept for s in sessions) <= 1e-3 * sum(s.bad for s in sessions)


@pytest.mark.whole
@pytest.mark.parametrize("share", [0.01, 0.1])
def test_drop_outs_of_a_session_are_left_out_of_its_field(share):
    session = measure(1, 25, share)
    assert session.bad > 0.7 * share * 3875
    assert_kept([session], 3 * ONE)


@pytest.mark.whole
@pytest.mark.parametrize("elements", [25, 50])
def test_hole_of_a_session_is_left_out_of_its_field(elements):
    session = measure(2, elements, hole=True)
    assert_kept([session], 3 * ONE)
    assert session.in_hole > 0
    assert session.known_in_hole == 0
    assert len(session.holes) == 1
    assert "are in a hole" in session.holes[0]


CASES = {f"{share:.1%}": (share, False) for share in SHARES} | {"hole": (0.0, True)}


@pytest.mark.long
@pytest.mark.parametrize("elements", NODES)
@pytest.mark.parametrize("case", CASES)
def test_drop_outs_and_holes_of_twelve_sessions(case, elements):
    sessions = [measure(seed, elements, *CASES[case]) for seed in range(12)]
    of_each = np.array([s.covered.mean() for s in sessions])
    by_component = [np.sqrt(np.sum([s.square for s in sessions], axis=0)
                            / np.sum([s.clean for s in sessions], axis=0)),
                    np.mean([s.covered for s in sessions], axis=0)]  # fmt: skip
    names = ("lost", "good", "kept", "bad", "in_hole", "known_in_hole", "blank")
    counts = {name: sum(getattr(s, name) for s in sessions) for name in names}
    print(case, elements, f"error {relative_error(sessions):.3f}", by_component[0].round(3),
          f"covered {of_each.mean():.4f} +- {of_each.std(ddof=1):.4f}",
          by_component[1].round(3), counts)  # fmt: skip
    assert_kept(sessions, 0.0)
    assert sum(s.known_in_hole for s in sessions) == 0
    assert all(len(s.holes) == (case == "hole") for s in sessions)
