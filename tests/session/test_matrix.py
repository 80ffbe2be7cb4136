"""Every instrument with every pose method on both D/A boards: a pose, or one sentence."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from sldvexp import config, config_source
from sldvexp.virtual_lab.lab import VirtualLab
from sldvexp.virtual_lab.server import LabServer

CONF = Path(__file__).parents[2] / "conf"

#: The same places on both boards, the finer one in eight times as many steps.
CENTRES = np.array([[-142, -704], [-401, -1326], [673, -1632], [748, -646]])
BOARDS = {"ometron": 1, "ometron_16bit": 8}

LAB = (
    "~experiment",
    "target=dissertation",
    "scene=calibration",
    "scene.views={front: {euler: [-1.153, 2.547, 1.913], origin: [0.862, 0.508, 1.553]}}",
    "signal=sine_fit",
)


def circles(steps):
    """Scans that `bitangent` and `edge` need."""
    return (
        "scan=calibration",
        f"scan.views={{front: {{dac: {(steps * CENTRES).tolist()}}}}}",
        f"scan.coarse={{pixels: 180, stride: {steps}}}",
        f"scan.fine={{lines: 8, stride: {steps}}}",
        "scan.sampling.samples=64",
    )


def image(steps):
    """What an instrument scans whose pose comes from elsewhere: a few pixels over a circle."""
    corners = (steps * (CENTRES[0] + [[0, 0], [0, 20], [20, 20], [20, 0]])).tolist()
    return (
        "scan=rectangle",
        f"scan.views={{front: {{corners: {corners}}}}}",
        "scan.pixels=[3,3]",
        "scan.sampling.samples=64",
    )


KNOWN = "pose.views={front: {euler: [-1.153, 2.547, 1.913], origin: [0.862, 0.508, 1.553]}}"
TRIPLES = (
    "pose.path=conf://data/digitizer_example.csv",
    "pose.instrument_points={low: [0.30,-0.25,-0.05], med: [-0.30,-0.25,0.10],"
    " high: [0.0,0.35,-0.20]}",
    "pose.object_points={lower_left: [0.0,0.0,0.0], lower_right: [0.28,0.0,0.0],"
    " upper_right: [0.28,0.28,0.0], upper_left: [0.0,0.28,0.0]}",
)
REGISTRATION = ("pose.path=conf://data/figure_4_28.reg",)
#: What each method needs: settings, and a scan or None if it does without.
METHODS = {
    "registration": (REGISTRATION, image),
    "manual": (REGISTRATION, image),
    "digitizer": (TRIPLES, image),
    "given": ((KNOWN,), image),
    "bitangent": ((), circles),
    "edge": ((), circles),
}
SCANNING = ("simulated", "visa", "replay")
INSTRUMENTS = (*SCANNING, "file")
NEEDS_SCANS = "scan: needs an instrument that scans, for example instrument=simulated"
#: What cannot be, and what is said then; everything else gives a pose.
IMPOSSIBLE = {("file", "bitangent"): NEEDS_SCANS, ("file", "edge"): NEEDS_SCANS}

#: Left to the long tests: what differs from a quick one by its board or its way to samples alone.
QUICK = {
    ("simulated", "bitangent", "ometron"),
    ("simulated", "edge", "ometron_16bit"),
    ("visa", "bitangent", "ometron_16bit"),
    ("visa", "registration", "ometron"),
    ("replay", "edge", "ometron"),
    ("replay", "given", "ometron_16bit"),
    ("simulated", "manual", "ometron_16bit"),
    ("visa", "digitizer", "ometron"),
    ("file", "registration", "ometron"),
    ("file", "edge", "ometron_16bit"),
}
MATRIX = [
    pytest.param(*cell, id="-".join(cell), marks=[pytest.mark.long] * (cell not in QUICK))
    for cell in itertools.product(INSTRUMENTS, METHODS, BOARDS)
]


def recorded(sldvexp, board, scan):
    """The folder of a run with these scan lines."""
    done = sldvexp(*LAB, f"laser={board}", "instrument=simulated", *scan(BOARDS[board]))
    assert done.status == 0, done.err
    return done.folder


@pytest.fixture
def served():
    """A server of the virtual lab with a board."""
    servers = []

    def made(board):
        config_source.install()
        with initialize_config_dir(str(CONF), version_base="1.3"):
            e = config.build(compose("config", overrides=[*LAB, f"laser={board}"]))
        servers.append(LabServer(VirtualLab(e.scene, e.laser, e.target, e.seed)).__enter__())
        return servers[-1].resource

    yield made
    for server in servers:
        server.__exit__()


@pytest.mark.parametrize(("instrument", "method", "board"), MATRIX)
def test_cell_gives_a_pose_or_one_sentence(instrument, method, board, sldvexp, served):
    settings, scan = METHODS[method]
    where = {
        "simulated": lambda: (),
        "visa": lambda: (f"instrument.resource={served(board)}",),
        "replay": lambda: (f"instrument.path={recorded(sldvexp, board, scan)}",),
        "file": lambda: ("instrument.path=conf://data/point_measured.csv",),
    }[instrument]()
    told = IMPOSSIBLE.get((instrument, method), "")
    scanned = scan(BOARDS[board]) if instrument in SCANNING or told else ()
    there = [s for s in LAB if instrument == "simulated" or "scene" not in s]
    done = sldvexp(*there, f"laser={board}", f"instrument={instrument}", *where, *scanned,
                   f"pose={method}", *settings)  # fmt: skip
    if told:
        assert done.status == 1
        (sentence,) = done.err.splitlines()
        assert re.search(told, sentence), sentence
        return
    assert done.status == 0, done.err
    tree = done.tree
    assert np.isfinite(tree["pose/origin"]).all()
    assert np.isfinite(tree["pose/rotation"]).all()
    if method in ("bitangent", "edge"):
        np.testing.assert_allclose(tree["pose/origin"][0], [0.862, 0.508, 1.553], atol=5e-4)
        np.testing.assert_allclose(tree["pose/euler"][0], [-1.153, 2.547, 1.913], atol=5e-4)
    elif instrument in SCANNING:
        assert tree["image/front/velocity"].shape == (9, 1)
        assert (tree["image/front/flags"] == 0).all()
        assert (np.abs(tree["image/front/velocity"]) > 0.005).all()
    else:
        assert "line_of_sight" in tree


def test_every_cell_is_in_the_matrix():
    """A new instrument or pose method must find its place there."""
    from sldvexp.registry import BUILT_IN

    assert set(BUILT_IN["pose"]) == set(METHODS)
    assert set(BUILT_IN["instrument"]) == set(INSTRUMENTS)
    assert {p.stem for p in (CONF / "laser").glob("*.yaml")} == set(BOARDS)
