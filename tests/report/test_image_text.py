"""What a run says about its images."""

from __future__ import annotations

import numpy as np

from sldvexp import dataset
from sldvexp.dataset import RunData
from sldvexp.report import image_text


def image(frequency, **attributes):
    """Six pixels, the largest of which is flagged."""
    amplitude = np.array([1e-3, -2e-3, 3e-3, 4e-3, 5e-3, 9.0]) * np.exp(0.7j)
    coords = {"pixel": np.arange(6), "frequency": np.array(frequency)}
    velocity = amplitude[:, None] * np.arange(1, len(frequency) + 1)
    std = np.broadcast_to(np.array([1, 2, 3, 4, 5, 99])[:, None] * 1e-6, velocity.shape)
    flags = np.array([0, 0, 0, 0, 0, 2])
    group = dataset.group("image", coords, velocity=velocity, velocity_std=std, flags=flags)
    return group.assign_attrs(summary="1 of 6 pixels are flagged (dropped_out 1)", **attributes)


def test_a_line_for_each_view():
    tree = {"image/front": image([450.0], shape=[2, 3]), "pose": None}
    tree["image/side"] = image([100.0, 200.5])
    assert image_text(RunData(tree)).splitlines() == [
        "Image of the view front (2 x 3): 1 of 6 pixels are flagged (dropped_out 1); "
        "450 Hz: at most 5 mm/s, median uncertainty 0.003 mm/s",
        "Image of the view side: 1 of 6 pixels are flagged (dropped_out 1); "
        "100 Hz: at most 5 mm/s, median uncertainty 0.003 mm/s; "
        "200.5 Hz: at most 10 mm/s, median uncertainty 0.003 mm/s",
    ]


def test_nothing_without_images():
    assert image_text(RunData({"pose": None})) == ""


def test_of_many_frequencies_the_strongest_are_told():
    told = image_text(RunData({"image/front": image([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])}))
    assert " 30 Hz: at most 15 mm/s" in told
    assert " 20 Hz:" not in told
    assert told.endswith("; 2 more frequencies")
