"""The figure of a plan: what it shows lies in its panels, and they fill the sheet."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import planner
from tests.planner.planned_experiments import PILLAR, SMALL, plan_of


@pytest.fixture(scope="module")
def plan():
    return plan_of(*SMALL, "plan.criterion=mean", "plan.stands=3", PILLAR)


@pytest.mark.whole
@pytest.mark.parametrize("width", [0.18, 0.085], ids=["page", "column"])
def test_panels_fill_the_sheet_and_lie_beside_one_another(plan, width):
    made = planner.figure.draw(plan, width=width)
    boxes = np.array([axes.get_tightbbox().extents for axes in made.axes])
    boxes /= made.dpi * np.tile(made.get_size_inches(), 2)
    assert boxes.min() > -0.01
    assert boxes.max() < 1.01
    sizes = boxes[:, 2:] - boxes[:, :2]
    assert sizes.prod(axis=1).sum() > 0.6
    for k, one in enumerate(boxes):
        for other in boxes[k + 1 :]:
            shared = np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2])
            assert (shared < 0.01).any()


def test_stands_stand_at_one_scale_where_they_are_planned(plan):
    above, front, *_ = planner.figure.draw(plan).axes
    for axes, side in ((above, [0, 2]), (front, [0, 1])):
        texts = {text.get_text(): text.xy for text in axes.texts}
        for stand in plan.stands:
            np.testing.assert_allclose(texts[stand.name], stand.origin[side])
        (a, b), (c, d) = axes.get_xlim(), axes.get_ylim()
        box = axes.get_position()
        wide, high = np.array([box.width, box.height]) * axes.figure.get_size_inches()
        assert wide / (b - a) == pytest.approx(high / abs(d - c), rel=1e-6)
