"""Modes against true ones: which are found, missed and false, and how far off they are."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.check import Examination
from sldvexp.check.modal_truth import ModalTruth
from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose
from sldvexp.virtual_lab.modes import Mode
from sldvexp.virtual_lab.plate import Plate, PlateScene

TRUE = [200.0, 300.0, 400.0]


def examined(found, std=0.1, line=(100.0, 500.0)):
    modes = {f"m{k}": Mode(k + 1, 1, frequency=f) for k, f in enumerate(TRUE)}
    views = {"1": KnownPose([0.0, np.pi, 0.0], [0.0, 0.0, 1.7])}
    scene = PlateScene(views=views, plate=Plate(modes=modes))
    count = len(found)
    group = dataset.group(
        "modes",
        {"mode": np.arange(1, count + 1), "line": [0, 1]},
        natural_frequency=found,
        natural_frequency_std=np.full(count, std),
        damping_ratio=np.full(count, 0.0101),
        damping_ratio_std=np.full(count, 1e-4),
        line_frequency=list(line),
    )
    run = Examination(
        {"modes": group},
        rng=np.random.default_rng(0),
        experiment=SimpleNamespace(scene=scene, scan=None),
    )
    return ModalTruth().examine(run)


def test_modes_near_true_ones_are_found_and_their_errors_told():
    found = examined([200.1, 300.0, 399.7])
    assert found["found"].values.tolist() == [1, 1, 1]
    assert (int(found["missed_modes"]), int(found["false_modes"])) == (0, 0)
    errors = found["natural_frequency_error"].values
    assert errors == pytest.approx([0.1 / 200, 0.0, -0.3 / 400])
    assert found["damping_ratio_error"].values == pytest.approx([0.01] * 3)
    # Of the frequencies the last is three standard errors off; of the damping none more than one.
    assert float(found["covered"]) == pytest.approx(5 / 6)


def test_missed_and_false_modes_are_counted():
    found = examined([200.0, 250.0, 299.5, 300.2])
    assert found["found"].values.tolist() == [1, 1, 0]
    assert (int(found["missed_modes"]), int(found["false_modes"])) == (1, 2)
    assert found["natural_frequency_error"].values[1] == pytest.approx(0.2 / 300)
    assert np.isnan(found["natural_frequency_error"].values[2])


def test_true_modes_beyond_the_lines_need_not_be_found():
    found = examined([200.0], line=(100.0, 250.0))
    assert found["true_mode"].values.tolist() == ["m0"]
    assert int(found["missed_modes"]) == 0


def test_a_run_without_modes_is_refused():
    run = Examination({}, rng=np.random.default_rng(0), experiment=SimpleNamespace(scene=None))
    with pytest.raises(UserError, match="choose modal=own and scene=plate"):
        ModalTruth().examine(run)
