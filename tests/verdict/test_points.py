"""Views of single points: clean ones are believed, a wrong one is named with its kind."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from sldvexp import dataset
from sldvexp.dataset import Severity
from sldvexp.errors import UserError
from sldvexp.verdict import examine_points

NOISE = 0.009
MISTAKES = ("sign", "conjugate", "rms", "gain", "phase", "direction")


def points(seed, views=5, lines=50, mistake="", noise=NOISE):
    """Simulate one point at many frequencies, one view of it wrong."""
    rng = np.random.default_rng(seed)
    tilt = np.radians(rng.uniform(15, 40, views))
    turn = 2 * np.pi * (np.arange(views) + rng.uniform(-0.3, 0.3, views)) / views
    stated = np.stack(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1
    )
    size = np.array([[0.3], [0.3], [1.0]])
    vector = size * (rng.standard_normal((3, lines)) + 1j * rng.standard_normal((3, lines)))
    wrong, true = int(rng.integers(views)), stated.copy()
    if mistake == "direction":
        true[wrong, rng.integers(2)] *= -1
    seen = true @ vector
    factor = {"sign": -1.0, "rms": 0.5**0.5, "gain": 1.1, "phase": np.exp(1j * np.radians(10))}
    seen[wrong] *= factor.get(mistake, 1.0)
    if mistake == "conjugate":
        seen[wrong] = np.conj(seen[wrong])
    seen = seen + NOISE * (rng.standard_normal(seen.shape) + 1j * rng.standard_normal(seen.shape))
    group = dataset.group(
        "line_of_sight",
        {"view": [f"v{k}" for k in range(views)], "frequency": np.arange(lines) + 100.0},
        direction_cosines=stated,
        velocity=seen,
        velocity_std=None if noise is None else np.full(seen.shape, noise),
    )
    return group, f"view v{wrong}"


def kinds(group, **options):
    """What is found that is more than a note."""
    found = examine_points(group, **options)[1]
    return [(f.kind, f.subject) for f in found if f.severity is not Severity.note]


@pytest.mark.parametrize("sessions", [10, pytest.param(100, marks=pytest.mark.whole)])
def test_clean_points_are_believed(sessions):
    wrong = sum(bool(kinds(points(seed)[0])) for seed in range(sessions))
    assert wrong <= binom.isf(1e-3, sessions, 0.01)


@pytest.mark.parametrize("sessions", [1, pytest.param(20, marks=pytest.mark.whole)])
@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize("views", [5, 6])
def test_wrong_view_is_named(mistake, views, sessions):
    """Of 97 %, as promised, fewer than 17 of 20 have a probability of 0.003."""
    right = 0
    for seed in range(sessions):
        group, wrong = points(seed, views, mistake=mistake)
        right += (mistake, wrong) in kinds(group)
    assert right >= 0.85 * sessions


def test_noise_that_is_too_small_is_told_in_words_of_points():
    found = examine_points(points(1, lines=6, noise=NOISE / 1.3)[0])[1]
    [finding] = [f for f in found if f.kind == "noise"]
    assert finding.text.startswith("the velocities lie 1.")
    assert "off what all views agree on" in finding.text
    assert "pixel" not in finding.text


def test_without_a_stated_noise_a_wrong_view_is_found_too():
    group, wrong = points(3, 6, mistake="sign", noise=None)
    assert kinds(group) == [("sign", wrong)]


@pytest.mark.whole
def test_clean_points_without_a_stated_noise_are_believed():
    """A kind that is tried is a test of its own, at a hundredth for all of them together."""
    for views in (4, 5):
        wrong = sum(bool(kinds(points(seed, views, noise=None)[0])) for seed in range(100))
        assert wrong <= binom.isf(1e-3, 100, 0.01)


@pytest.mark.parametrize("sessions", [2, pytest.param(5, marks=pytest.mark.whole)])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_four_views_without_a_stated_noise_show_that_one_is_wrong(mistake, sessions):
    for seed in range(sessions):
        assert kinds(points(seed, 4, mistake=mistake, noise=None)[0])


def test_three_views_say_what_they_cannot_see():
    group, _ = points(0, 3, mistake="sign")
    (found,) = examine_points(group)[1]
    assert (found.kind, found.severity) == ("untested", Severity.note)
    assert "cannot be seen" in found.text


def test_repair_is_taken_where_it_is_named_and_the_rest_is_untouched():
    group, wrong = points(5, mistake="sign")
    view = wrong.removeprefix("view ")
    repaired, found = examine_points(group, [f"view_{view}.sign"])
    assert [f.kind for f in found] == ["repaired"]
    ratio = (repaired["velocity"] / group["velocity"]).sel(frequency=100.0).values
    expected = np.where(group["view"].values == view, -1.0, 1.0)
    np.testing.assert_allclose(ratio, expected, rtol=1e-12)


def test_repair_that_nothing_proposes_is_refused():
    with pytest.raises(
        UserError, match=r"use_repair: nothing that was found proposes view_v9.sign"
    ):
        examine_points(points(5)[0], ["view_v9.sign"])


def test_missing_velocities_have_no_say():
    group, wrong = points(8, 6, mistake="sign")
    values = group["velocity"].values.copy()
    values[(int(wrong[-1]) + 1) % 6, ::2] = np.nan
    group["velocity"] = group["velocity"].copy(data=values)
    assert kinds(group) == [("sign", wrong)]


def grid_of_points(seed, views=5, std=NOISE):
    """Simulate six points at six frequencies: the group, and the true noise added."""
    rng = np.random.default_rng(seed)
    group, _ = points(seed, views, lines=36)
    seen = group["velocity"].values.reshape(views, 6, 6)
    labels = {"view": group["view"].values, "point": np.arange(1, 7)}
    labels["frequency"] = 400.0 + 10 * np.arange(6)
    made = dataset.group(
        "line_of_sight",
        labels,
        direction_cosines=np.repeat(group["direction_cosines"].values[:, None], 6, axis=1),
        velocity=seen,
        velocity_std=np.full(seen.shape, std),
    )
    return made, int(rng.integers(views))


@pytest.mark.parametrize(
    ("spoil", "place"),
    [
        (lambda v: v.__setitem__((2, 3), -v[2, 3]), "at point 3 at 430 Hz alone"),
        (lambda v: v.__setitem__((2, 3), 10 * v[2, 3]), "at point 3 at 430 Hz alone"),
        (lambda v: v.__setitem__(4, -v[4]), "at point 5 alone"),
        (lambda v: v.__setitem__((slice(None), 1), 1.3 * v[:, 1]), "at 410 Hz alone"),
        (lambda v: v.__setitem__([1, 2], v[[2, 1]]), "at point 2 and point 3 alone"),
    ],
    ids=["a sign", "a digit", "a point", "a line", "two points exchanged"],
)
@pytest.mark.parametrize("sessions", [3, pytest.param(10, marks=pytest.mark.whole)])
def test_single_wrong_values_are_named_with_their_places(spoil, place, sessions):
    named = 0
    for seed in range(sessions):
        group, wrong = grid_of_points(seed)
        spoil(group["velocity"].values[wrong])
        [finding] = examine_points(group)[1]
        assert finding.severity is Severity.void
        named += finding.kind == "other_values" and f"v{wrong}" in finding.text
        named -= place not in finding.text
    assert named >= 0.9 * sessions


def test_wrong_value_of_four_views_is_placed_though_not_in_a_view():
    group, wrong = grid_of_points(3, views=4)
    group["velocity"].values[wrong, 2, 3] *= -1
    [finding] = examine_points(group)[1]
    assert (finding.kind, finding.subject) == ("other_values", "a view")
    assert "at point 3 at 430 Hz alone; four views cannot tell which" in finding.text


@pytest.mark.parametrize("sessions", [3, pytest.param(10, marks=pytest.mark.whole)])
@pytest.mark.parametrize("small", [3, 1000])
def test_noise_in_another_unit_accuses_no_view(small, sessions):
    for seed in range(sessions):
        [finding] = examine_points(grid_of_points(seed, std=NOISE / small)[0])[1]
        assert (finding.kind, finding.subject) == ("noise", "views")
        assert finding.severity is Severity.doubtful
        assert "more than one view is wrong, or directions are less" in finding.text


def test_noise_that_is_stated_a_thousand_times_too_large_is_asked_for_its_unit():
    [finding] = examine_points(grid_of_points(0, std=1e3 * NOISE)[0])[1]
    assert finding.severity is Severity.note
    assert "is that in another unit?" in finding.text


@pytest.mark.parametrize("sessions", [3, pytest.param(10, marks=pytest.mark.whole)])
@pytest.mark.parametrize("factor", [-1.0, 1.1])
def test_two_wrong_views_are_said_to_be_more_than_one(factor, sessions):
    for seed in range(sessions):
        group, wrong = grid_of_points(seed)
        group["velocity"].values[[wrong, wrong - 1]] *= factor
        [finding] = examine_points(group)[1]
        assert finding.severity is not Severity.note
        assert "more than one view is wrong" in finding.text


@pytest.mark.parametrize("views", [3, 5])
def test_velocities_that_were_read_twice_are_named(views):
    group, _ = grid_of_points(1, views)
    group["velocity"].values[2] = group["velocity"].values[0]
    found = examine_points(group)[1][0]
    assert (found.kind, found.subject) == ("repeated", "views v0 and v2")
    assert found.severity is Severity.void
