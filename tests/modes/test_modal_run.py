"""Modes of a run: groups, mode shapes by every kind of reconstruction, and what is said of them."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import RunData
from sldvexp.report import closing_lines

#: A quick session of lines every 5 Hz around two modes.
LINES = [float(f) for f in range(400, 585, 5)]
SMALL = [
    *("experiment=plate_frf", "modal=own", "report=none", "~compare.samplewise"),
    *("~check.truth", "~check.samplewise"),
    *("~expect.truth", "~expect.resonances", "~expect.all_lines"),
    *(
        "~scan.views.4",
        "~scan.views.5",
        "scan.pixels=[13,15]",
        "volume.shape=[7,6]",
        "volume.layers=2",
    ),
    f"scan.sampling.frequency={LINES}".replace(" ", ""),
]
CHECKED = ["+check.modes={plugin: modal_truth}"]


@pytest.mark.parametrize(
    ("reconstruction", "mac"),
    [
        ("shell", 0.9995),
        pytest.param("samplewise", 0.997, marks=pytest.mark.whole),  # linear in 4 cm elements
    ],
)
def test_modal_images_become_mode_shapes_with_bounds(sldvexp, reconstruction, mac):
    done = sldvexp(*SMALL, *CHECKED, f"reconstruction={reconstruction}")
    assert done.status == 0, done.err
    tree = done.tree
    natural = tree["modes/natural_frequency"].values
    assert natural == pytest.approx([439.0, 545.0], rel=1e-4)
    field = tree["modes/field"]
    assert field["frequency"].values.tolist() == natural.tolist()
    assert ("strain" in tree["modes"].children) == (reconstruction == "shell")
    found = tree["examined/modes"]
    assert int(found["false_modes"]) == int(found["missed_modes"]) == 0
    assert np.all(found["mac"].sel(component="z").values > mac)
    assert "2 modes: 43" in done.out
    assert tree["image"].children.keys() == tree["modes/image"].children.keys()


@pytest.mark.whole
def test_without_a_reconstruction_there_are_modal_images_alone(sldvexp):
    done = sldvexp(*SMALL, "~reconstruction")
    assert done.status == 0, done.err
    assert list(done.tree["modes"].children) == ["image"]
    lines = dict(closing_lines(RunData.from_source(done.tree), [done.folder / "run.nc"]))
    assert "2 modes: 43" in lines["found"]


def test_a_band_without_modes_ends_the_run_with_a_sentence(sldvexp):
    done = sldvexp(*SMALL, "~reconstruction", "modal.band=[460,510]")
    assert done.status == 1
    assert "modal: no mode lies between 460 and 510 Hz" in done.err
