"""Published numbers against a run's: what passes, what fails, what is a mistake."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.check import evaluate
from sldvexp.config.schema import Expectation
from sldvexp.errors import UserError


def tree():
    pose = dataset.group(
        "pose", {"view": ["front"]}, origin=[[1.0, 2.0, 3.0]], sse=[0.5], residual_rms=[np.nan]
    )
    pose.attrs["fit"] = 0.25
    point = dataset.group("point", {}, velocity=[1 + 1j, 2.0, 3j])
    return {"pose": pose, "point": point}


def passed(**expectation):
    found = evaluate({"e": Expectation(source="here", **expectation)}, tree())
    return found["passed"].values.astype(bool).tolist()


def test_numbers_pass_within_their_tolerance_and_fail_beyond():
    assert passed(published={"pose/origin": [1.0, 2.1, 3.0]}, tolerance=0.05) == [True, False, True]
    assert passed(published={"pose/origin[axis=y]": 2.0}) == [True]
    assert passed(published={"pose@fit": 0.25}) == [True]


def test_complex_numbers_pass_by_real_and_imaginary_part():
    published = {"point/velocity": ["1+1.01j", "2-0.2i", "3j"]}
    assert passed(published=published, tolerance=0.1) == [True, False, True]


def test_what_is_expected_of_a_mistake_is_not_compared_once_it_is_repaired():
    here = Expectation(at_most={"pose/sse": 0.6})
    mistake = Expectation(verdict="void", at_least={"pose/sse": 0.9}, unrepaired=True)
    expect = {"named": mistake, "sse": here}
    before = evaluate(expect, tree())
    assert before["passed"].values.tolist() == [0, 0, 1]
    assert "notes" not in before.attrs
    after = evaluate(expect, tree(), repaired=True)
    assert after["quantity"].values.tolist() == ["sse: pose/sse"]
    assert after.attrs["notes"].startswith("expected named: not compared, as it is of the session")


def test_bounds_and_nan():
    assert passed(at_most={"pose/sse": 0.4}) == [False]
    assert passed(at_least={"pose/sse": 0.4}, at_most={"pose/sse": 0.6}) == [True, True]
    assert passed(at_most={"pose/residual_rms": 1.0}) == [False]
    assert passed(at_most={"pose/sse": 0.4}, tolerance=0.2) == [True]


def test_the_correct_formula_stands_beside():
    found = evaluate(
        {"e": Expectation(published={"pose/sse": 0.5}, correct={"pose/sse": "pose@fit"})}, tree()
    )
    assert found["correct"].item() == 0.25


@pytest.mark.parametrize(
    ("expectation", "message"),
    [
        ({"published": {"pose/orign": 1}}, "pose has no variable orign; did you mean origin"),
        ({"published": {"poes/origin": 1}}, "the run has no group poes; did you mean pose"),
        ({"published": {"pose@fti": 1}}, "pose has no attribute fti; did you mean fit"),
        ({"published": {"pose/origin[axs=y]": 1}}, "there is no dimension axs"),
        ({"published": {"pose/origin[axis=w]": 1}}, "axis has no label w"),
        ({"published": {"pose/origin": [1, 2]}}, "published has 2 numbers, but the run has 3"),
        ({"published": {"pose/sse": "much"}}, "must be numbers, not 'much'"),
        ({"published": {"sse": 1}}, "is not of the form group/variable"),
    ],
)
def test_mistakes_in_an_expectation_are_named(expectation, message):
    with pytest.raises(UserError, match=message):
        evaluate({"e": Expectation(**expectation)}, tree())
