"""Speed of scanning over a socket: the 8,000 pixels of a calibration object, in lines of 300.

Figures are asserted with ``SLDVEXP_BENCHMARK=1`` only; otherwise nothing of it is done.
"""

from __future__ import annotations

import os
import time

import numpy as np
import pytest

from sldvexp.instrument import Acquisition
from sldvexp.instrument.visa import Visa
from sldvexp.virtual_lab import LabServer, VirtualLab
from tests.composing import experiment

PIXELS, LINE, ROUNDS = 8000, 300, 3
SECONDS = 5.0
#: Share of the time in which something is computed or copied, and nobody waits for a socket.
BUSY = 0.5


@pytest.mark.skipif(
    os.environ.get("SLDVEXP_BENCHMARK") != "1",
    reason="needs a quiet machine; set SLDVEXP_BENCHMARK=1",
)
def test_a_whole_calibration_object_in_a_moment() -> None:
    """The round that others disturbed least counts."""
    e = experiment("~experiment", "scene=calibration", "target=dissertation")
    lab = VirtualLab(e.scene, e.laser, e.target, e.seed)
    dac = np.random.default_rng(1).integers(-700, 700, (PIXELS, 2))
    busy, took = [], []
    with LabServer(lab) as server, Visa(server.resource).open() as ours:
        ours.configure(Acquisition(10000.0, 256, (450.0,)))
        for _ in range(ROUNDS):
            begin, used = time.perf_counter(), time.process_time()
            for first in range(0, PIXELS, LINE):
                ours.scan(dac[first : first + LINE])
            took.append(time.perf_counter() - begin)
            busy.append((time.process_time() - used) / took[-1])
    print(f"{PIXELS} pixels: {min(took):.2f} s, {max(busy):.0%} of a core")
    assert min(took) < SECONDS
    assert max(busy) > BUSY
