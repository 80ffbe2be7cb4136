"""Edges of circles that a scan loses are told where they are more than a scan in order loses."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import Severity
from sldvexp.image import ScanLineEdges
from sldvexp.image.scan_lines import Reason
from sldvexp.pose.from_scans import lost_edges
from sldvexp.session.circles import edges_to_dataset


def circle(found, lost, reason=Reason.profile):
    """A circle of which so many edges were found and lost."""
    zero, pairs = np.zeros(found), np.zeros((found, 2))
    return ScanLineEdges(
        pairs,
        zero + 1,
        pairs + np.array([1.0, 0.0]),
        zero + 3,
        np.arange(found),
        np.ones(found, bool),
        zero,
        tuple((found + k, reason) for k in range(lost)),
        found + lost,
        "circle 1",
    )


@pytest.mark.parametrize("lost", [0, 4])
def test_few_lost_edges_are_usual(lost):
    assert lost_edges("3", edges_to_dataset([circle(44 - lost, lost)] * 4)) == []


def test_many_lost_edges_are_told_with_their_reasons():
    seen = [circle(33, 11), circle(36, 8), circle(34, 9), circle(36, 7, Reason.flagged)]
    (found,) = lost_edges("3", edges_to_dataset(seen))
    assert found.severity is Severity.note
    assert found.size == pytest.approx(35 / 174)
    assert found.subject == "view 3"
    assert (
        "20 % of the edges of its circles were lost (28 that no edge profile fits, 7 with flagged "
        "pixels at the edge)" in found.text
    )


def test_scans_of_older_runs_tell_no_lost_edges():
    group = edges_to_dataset([circle(20, 20)])
    del group.attrs["lost"]
    assert lost_edges("3", group) == []
