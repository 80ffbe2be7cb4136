"""Edges on scan lines: where they are, how well that is known, and what is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from sldvexp.errors import UserError
from sldvexp.image import (
    ScanLineEdges,
    ScanLines,
    edge_profile,
    gradient_edges,
    pixel_edges,
    profile_edges,
)
from sldvexp.image.edge_detection import COARSE_WINDOW, FINE_WINDOW
from sldvexp.image.edge_profile import fit_profiles, step_profile
from sldvexp.image.scan_lines import Reason

METHODS = {"gradient": gradient_edges, "profile": profile_edges}
NOISE = 0.01


def lines_with_edges(
    edge: np.ndarray,
    width: float = 1.5,
    noise: float = NOISE,
    pixels: int = 25,
    pitch: float = 1.0,
    seed: int = 0,
) -> ScanLines:
    """Lines in all directions, half of them rising, with edges so far from the middle."""
    rng = np.random.default_rng(seed)
    count = len(edge)
    along = pitch * (np.arange(pixels) - (pixels - 1) / 2)
    sense = np.where(np.arange(count) % 2, 1.0, -1.0)[:, None]
    magnitude = ndtr(sense * (along - edge[:, None]) / width)
    magnitude = magnitude + noise * rng.normal(size=magnitude.shape)
    position = np.array([100.0, -2000.0]) + along[:, None] * directions(count)[:, None]
    return lines(magnitude, position, noise)


def directions(count: int) -> np.ndarray:
    turn = 2.4 * np.arange(count)
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


def lines(magnitude: np.ndarray, position: np.ndarray, noise: float = NOISE) -> ScanLines:
    flag = np.zeros(magnitude.shape, bool)
    return ScanLines(magnitude, np.full(magnitude.shape, noise), position, flag, "circle 2")


def horizontal(magnitude: np.ndarray, noise: float = NOISE) -> ScanLines:
    count, pixels = magnitude.shape
    row, column = np.meshgrid(np.arange(count), np.arange(pixels), indexing="ij")
    return lines(magnitude, np.stack([column, 10.0 * row], axis=-1).astype(float), noise)


def errors(found: ScanLineEdges, edge: np.ndarray) -> np.ndarray:
    true = np.array([100.0, -2000.0]) + edge[:, None] * directions(len(edge))
    return ((found.position - true[found.line]) * found.direction).sum(axis=1)


def disc(count: int, pixels: int = 300, seed: int = 0, noise: float = NOISE) -> ScanLines:
    """Lines across a whole circle, moving from pixel 80.3 to 210.8."""
    rng = np.random.default_rng(seed)
    t = np.arange(pixels)
    inside = ndtr((t - 80.3) / 1.5) - ndtr((t - 210.8) / 1.5)
    return horizontal(inside + noise * rng.normal(size=(count, pixels)), noise)


def expected_std(width: float, noise: float) -> float:
    """Cramer-Rao bound of one edge with all four numbers of its profile unknown."""
    places = np.linspace(-0.5, 0.5, 21)
    numbers = np.tile([0.0, np.log(width), 0.0, 1.0], (21, 1))
    numbers[:, 0] = places
    _, jacobian = step_profile(np.arange(25)[None] - 12.0, numbers)
    information = np.swapaxes(jacobian, 1, 2) @ jacobian / noise**2
    return float(np.median(np.sqrt(np.linalg.inv(information)[:, 0, 0])))


@pytest.mark.parametrize("width", [0.6, 1.5, 2.5])
def test_profile_is_unbiased_and_as_good_as_its_stated_errors(width: float) -> None:
    count = 1000
    edge = np.random.default_rng(1).uniform(-4.0, 4.0, count)
    found = profile_edges(lines_with_edges(edge, width), 1, FINE_WINDOW)
    error = errors(found, edge) / found.std
    assert len(error) == count
    assert abs(error.mean()) < 4.5 / np.sqrt(count)
    assert error.std() == pytest.approx(1.0, abs=0.01 + 4.5 / np.sqrt(2 * count))
    assert np.median(found.std) == pytest.approx(expected_std(width, NOISE), rel=0.05)
    assert np.median(found.width) == pytest.approx(width, rel=0.02)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("width", [0.6, 1.5, 2.5])
def test_gradient_is_nearly_unbiased_and_worse_than_the_profile(width: float) -> None:
    count = 3000
    edge = np.random.default_rng(1).uniform(-4.0, 4.0, count)
    scanned = lines_with_edges(edge, width)
    found = gradient_edges(scanned, 1, FINE_WINDOW)
    error = errors(found, edge)
    assert abs(error.mean()) < 4.5 * error.std() / np.sqrt(count)
    assert error.std() > 1.5 * errors(profile_edges(scanned, 1, FINE_WINDOW), edge).std()
    # to first order only: taking the largest of noisy gradients adds up to a third
    assert (error / found.std).std() < 1.4
    assert np.median(found.width) == pytest.approx(width, abs=0.15)


def test_a_pixel_is_the_nearest_one_to_the_edge() -> None:
    count = 3000
    edge = np.random.default_rng(1).uniform(-4.0, 4.0, count)
    scanned = lines_with_edges(edge, noise=1e-4)
    found = pixel_edges(scanned, 1, FINE_WINDOW)
    apart = np.abs(found.position[:, None] - scanned.position[found.line]).max(axis=-1)
    np.testing.assert_allclose(apart.min(axis=1), 0, atol=1e-9)
    error = errors(found, edge)
    assert np.abs(error).max() < 0.51
    # Uniform within half a pixel, to 4.5 standard errors of its standard deviation.
    assert error.std() == pytest.approx(12**-0.5, abs=4.5 * 0.13 / np.sqrt(count))
    assert np.median(found.std) == pytest.approx(12**-0.5, rel=0.02)


@pytest.mark.parametrize("method", METHODS)
def test_a_spot_smaller_than_a_pixel_leaves_a_pixel_of_doubt(method: str) -> None:
    edge = np.random.default_rng(2).uniform(-4.0, 4.0, 400)
    found = METHODS[method](lines_with_edges(edge, width=0.05, noise=0.02), 1, FINE_WINDOW)
    error = errors(found, edge)
    assert len(error) == 400
    assert np.abs(error).max() < 0.6
    assert np.median(found.std) == pytest.approx(1 / np.sqrt(12.0), rel=0.01)
    assert error.std() < 1.1 * np.median(found.std)


@pytest.mark.parametrize("method", METHODS)
def test_pitch_and_direction_of_the_lines_do_not_matter(method: str) -> None:
    edge = np.linspace(-12.0, 12.0, 40)
    scanned = lines_with_edges(edge, width=4.5, noise=1e-6, pitch=3.0)
    found = METHODS[method](scanned, 1, FINE_WINDOW)
    assert np.abs(errors(found, edge)).max() < (0.15 if method == "gradient" else 1e-4)
    assert found.direction == pytest.approx(directions(40))
    assert found.rising.tolist() == [False, True] * 20


@pytest.mark.parametrize("method", METHODS)
def test_a_line_across_a_circle_rises_and_falls(method: str) -> None:
    found = METHODS[method](disc(3), 2, COARSE_WINDOW)
    assert found.line.tolist() == [0, 0, 1, 1, 2, 2]
    assert found.rising.tolist() == [True, False] * 3
    # a median of 25 noisy pixels flattens the top of the gradient
    within = 1.5 if method == "gradient" else 4.5 * expected_std(1.5, NOISE)
    assert np.abs(found.position[:, 0] - np.tile([80.3, 210.8], 3)).max() < within
    assert found.position[:, 1].tolist() == [0.0, 0.0, 10.0, 10.0, 20.0, 20.0]
    assert (found.lines, found.rejected) == (3, ())


def test_dropouts_do_not_move_a_profile() -> None:
    """Every line has a dark and a wrongly bright pixel away from the slope."""
    edge = np.random.default_rng(3).uniform(-2.0, 2.0, 200)
    scanned = lines_with_edges(edge)
    magnitude = scanned.magnitude.copy()
    magnitude[:, [2, 22]] = 0.4
    found = profile_edges(lines(magnitude, scanned.position), 1, FINE_WINDOW)
    assert len(found.std) == 200
    assert (errors(found, edge) / found.std).std() == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("method", METHODS)
def test_flagged_pixels_are_not_used(method: str) -> None:
    edge = np.random.default_rng(4).uniform(-2.0, 2.0, 100)
    scanned = lines_with_edges(edge)
    flag = np.zeros(scanned.flag.shape, bool)
    flag[:, 3:7] = True
    flag[::2, 14] = True
    magnitude = np.where(flag, np.nan, scanned.magnitude)
    std = np.where(flag, np.nan, scanned.std)
    marked = ScanLines(magnitude, std, scanned.position, flag, "circle 2")
    found = METHODS[method](marked, 1, FINE_WINDOW)
    assert len(found.std) == 100
    assert np.isfinite(found.std).all()
    assert np.abs(errors(found, edge)).max() < (0.5 if method == "gradient" else 0.15)


def test_standard_errors_grow_where_the_pixels_scatter_more_than_stated() -> None:
    edge = np.random.default_rng(5).uniform(-4.0, 4.0, 1000)
    scanned = lines_with_edges(edge, noise=3 * NOISE)
    optimist = lines(scanned.magnitude, scanned.position, NOISE)
    found = profile_edges(optimist, 1, FINE_WINDOW)
    assert (errors(found, edge) / found.std).std() == pytest.approx(1.0, abs=0.12)


def outlines(shape: str) -> np.ndarray:
    """One line of 25 pixels that has no good edge."""
    t = np.arange(25.0)
    return {
        "dead": np.zeros(25),
        "inside": np.ones(25),
        "left end": ndtr((t - 2.0) / 1.0),
        "right end": ndtr((t - 23.0) / 1.0),
        "weak": 0.04 * ndtr((t - 12.0) / 1.0),
    }[shape]


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        ("dead", Reason.contrast),
        ("inside", Reason.contrast),
        ("left end", Reason.end),
        ("right end", Reason.end),
        ("weak", Reason.contrast),
    ],
)
@pytest.mark.parametrize("method", METHODS)
def test_what_is_no_edge_is_rejected_for_its_reason(
    shape: str, reason: Reason, method: str
) -> None:
    rng = np.random.default_rng(6)
    count = 60
    magnitude = outlines(shape) + NOISE * rng.normal(size=(count, 25))
    found = METHODS[method](horizontal(magnitude), 1, FINE_WINDOW)
    assert found.counts() == {reason: count}
    assert found.summary() == f"0 edges on {count} scan lines; rejected {count} {reason.value}"


@pytest.mark.parametrize("method", METHODS)
def test_a_line_that_falls_before_it_rises_is_rejected(method: str) -> None:
    """A resting circle on a moving plate is not what the calibration object shows."""
    scanned = disc(2)
    found = METHODS[method](horizontal(1.0 - scanned.magnitude), 2, COARSE_WINDOW)
    assert found.counts() == {Reason.order: 4}


@pytest.mark.parametrize("method", METHODS)
def test_one_good_edge_of_two_is_kept(method: str) -> None:
    """A line that ends inside the circle."""
    found = METHODS[method](horizontal(disc(2).magnitude[:, :150]), 2, COARSE_WINDOW)
    assert found.rising.tolist() == [True, True]
    assert sum(found.counts().values()) == 2


@pytest.mark.parametrize("method", METHODS)
def test_flagged_edges_are_rejected(method: str) -> None:
    scanned = lines_with_edges(np.zeros(4))
    flag = np.zeros(scanned.flag.shape, bool)
    flag[0] = True
    flag[1, 4:20] = True
    marked = ScanLines(scanned.magnitude, scanned.std, scanned.position, flag, "circle 2")
    found = METHODS[method](marked, 1, FINE_WINDOW)
    assert found.rejected == ((0, Reason.flagged), (1, Reason.flagged))


def test_a_slope_that_is_no_edge_fits_no_profile() -> None:
    """Waves upon an edge, among good edges."""
    scanned = lines_with_edges(np.zeros(20))
    magnitude = scanned.magnitude.copy()
    along = np.arange(25) - 12.0
    magnitude[3] += 0.1 * np.sin(1.3 * along)
    found = profile_edges(lines(magnitude, scanned.position), 1, FINE_WINDOW)
    assert found.rejected == ((3, Reason.profile),)


@pytest.mark.whole
def test_component_in_phase_is_unbiased_where_the_magnitude_is_not() -> None:
    """Complex noise of a twentieth of the motion makes the edge of a magnitude move inwards."""
    rng = np.random.default_rng(7)
    count = 2000
    edge = rng.uniform(-2.0, 2.0, count)
    still = lines_with_edges(edge, noise=0.0001)
    noise = 0.05 * (rng.normal(size=(count, 25)) + 1j * rng.normal(size=(count, 25)))
    velocity = (still.magnitude + noise) * np.exp(2.5j)
    std = np.full((count, 25), 0.05)
    inwards = np.where(np.arange(count) % 2, 1.0, -1.0)

    found = profile_edges(
        ScanLines.of_velocity(velocity, std, still.position, still.flag), 1, FINE_WINDOW
    )
    error = errors(found, edge) * inwards[found.line]
    assert found.rising.tolist() == still.magnitude[found.line, -1].round().astype(bool).tolist()
    assert abs(error.mean()) < 4.5 * error.std() / np.sqrt(count)
    assert (error / found.std).std() == pytest.approx(1.0, abs=0.1)
    found = profile_edges(ScanLines(np.abs(velocity), std, still.position, still.flag), 1, 5)
    biased = errors(found, edge) * inwards[found.line]
    assert biased.mean() > 10 * biased.std() / np.sqrt(count)


@pytest.mark.parametrize("phase", np.linspace(-3.0, 3.0, 5))
def test_component_in_phase_is_the_whole_motion(phase: float) -> None:
    still = lines_with_edges(np.zeros(6))
    velocity = still.magnitude * np.exp(1j * phase)
    found = ScanLines.of_velocity(velocity, still.std, still.position, still.flag)
    assert found.magnitude == pytest.approx(still.magnitude, abs=1e-9)


@pytest.mark.parametrize("width", [0.6, 1.5])
@pytest.mark.parametrize("method", METHODS)
def test_oblique_lines_of_whole_steps_place_edges_between_them(method: str, width: float) -> None:
    """A unit pitch along a diagonal, rounded, stands still now and then and runs beside its line.

    The edge is 4 deg off square to the lines, as after a coarse fit.
    """
    rng = np.random.default_rng(8)
    count, noise = 400, 0.002
    t = np.arange(25) - 12.0
    start = rng.uniform(0.0, 1.0, (count, 1, 2))
    position = np.round(np.stack([0.6 * t, 0.8 * t], axis=1) + start)
    assert np.any(np.all(np.diff(position, axis=1) == 0, axis=-1))
    askew = np.arctan2(0.8, 0.6) + np.radians(4.0)
    normal = np.array([np.cos(askew), np.sin(askew)])
    magnitude = ndtr((position @ normal - 0.4) / width) + noise * rng.normal(size=(count, 25))
    found = METHODS[method](lines(magnitude, position, noise), 1, FINE_WINDOW)
    error = found.position @ normal - 0.4
    assert len(error) > 0.98 * count
    assert error.std() < (0.12 if method == "gradient" else 1.6 * np.median(found.std))


@pytest.mark.parametrize("method", METHODS)
def test_a_circle_smaller_than_the_window_has_both_edges(method: str) -> None:
    t = np.arange(60.0)
    inside = ndtr((t - 24.3) / 1.2) - ndtr((t - 34.6) / 1.2)
    rng = np.random.default_rng(9)
    scanned = horizontal(inside + NOISE * rng.normal(size=(40, 60)))
    found = METHODS[method](scanned, 2, FINE_WINDOW)
    assert len(found.std) == 80
    error = found.position[:, 0] - np.tile([24.3, 34.6], 40)
    assert np.abs(error / found.std).max() < 5.0


def broken(**changes: np.ndarray) -> dict[str, np.ndarray]:
    good = lines_with_edges(np.zeros(3))
    parts = {
        "magnitude": good.magnitude,
        "std": good.std,
        "position": good.position,
        "flag": good.flag,
    }
    return parts | changes


def changed(values: np.ndarray, line: int, pixel: int, to: object) -> np.ndarray:
    values = values.copy()
    values[line, pixel] = to
    return values


GOOD = broken()


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        (broken(std=GOOD["std"][:2]), r"must be \(line, pixel\) and positions .*, not \(3, 25\)"),
        (broken(position=GOOD["position"][..., 0]), r"positions \(line, pixel, 2\)"),
        (
            {k: v[:, :4] for k, v in GOOD.items()},
            "circle 4: a scan line needs 5 pixels or more, not 4",
        ),
        (
            broken(magnitude=changed(GOOD["magnitude"], 1, 7, np.nan)),
            "circle 4: pixel 7 of scan line 1 has no finite magnitude with a positive standard",
        ),
        (
            broken(std=changed(GOOD["std"], 2, 3, 0.0)),
            "circle 4: pixel 3 of scan line 2 has no finite magnitude with a positive standard",
        ),
        (
            broken(position=changed(GOOD["position"], 0, 5, np.inf)),
            "circle 4: pixel 5 of scan line 0 has no finite position",
        ),
        (
            broken(position=changed(GOOD["position"], 2, 12, [150.0, -1900.0])),
            "circle 4: pixel 12 of scan line 2 stands beside its line, which must be straight",
        ),
        (
            broken(position=GOOD["position"][:, [0, 1, 2, 4, 3, *range(5, 25)]]),
            "circle 4: pixel 3 of scan line 0 is followed by one that turns back",
        ),
        (
            broken(position=np.zeros((3, 25, 2))),
            "circle 4: pixel 0 of scan line 0 stands where the whole line does",
        ),
    ],
    ids=["shape", "position", "short", "nan", "std", "inf", "beside", "back", "still"],
)
def test_scan_lines_that_cannot_be_are_refused(parts: dict[str, np.ndarray], says: str) -> None:
    with pytest.raises(UserError, match=says):
        ScanLines(**parts, name="circle 4")


def test_an_edge_that_its_pixels_do_not_tell_does_not_end_the_others():
    """One with four pixels left beside a good one; seed 313 of 900 made its equations singular."""
    along = np.tile(np.arange(25.0), (2, 1))
    start = np.array([[12.0, 0.0, 0.0, 1.0]] * 2)
    profile = step_profile(along[:1], np.array([[12.3, 0.3, 0.0, 1.0]]))[0][0]
    for seed in range(300, 320):
        rng = np.random.default_rng(seed)
        seen = profile + np.array([[0.01], [0.3]]) * rng.standard_normal((2, 25))
        weight = np.full((2, 25), 100.0)
        weight[1] = 0.0
        weight[1, rng.choice(25, 4, replace=False)] = 100.0
        found = fit_profiles(along, seen, seen, weight, start, np.ones(2))
        assert abs(found.edge[0] - 12.3) < 5 * found.edge_std[0]


def profiles(magnitude: np.ndarray, weight: np.ndarray) -> edge_profile.Profiles:
    along = np.tile(np.arange(25.0), (len(magnitude), 1))
    start = np.tile([12.0, 0.0, 0.0, 1.0], (len(magnitude), 1))
    return fit_profiles(along, magnitude, magnitude, weight, start, np.ones(len(magnitude)))


def stubborn() -> tuple[np.ndarray, np.ndarray]:
    """Edges of which the third has no pixels on its slope and takes 60 steps."""
    rng = np.random.default_rng(3)
    edge = 12.0 + rng.uniform(-0.5, 0.5, (20, 1))
    seen = ndtr((np.arange(25.0) - edge) / 1.2) + 0.01 * rng.standard_normal((20, 25))
    weight = np.full((20, 25), 100.0)
    weight[3, 9:16] = 0.0
    return seen, weight


def test_an_edge_is_the_same_whichever_others_are_fitted_with_it():
    seen, weight = stubborn()
    together = profiles(seen, weight)
    for k in range(20):
        alone = profiles(seen[[k]], weight[[k]])
        for name in ("edge", "width", "edge_std", "gain", "chi_square", "settled"):
            np.testing.assert_array_equal(getattr(together, name)[[k]], getattr(alone, name))


def test_edges_that_have_settled_are_left_alone(monkeypatch):
    """One that does not has them computed no oftener: 300 evaluations, not 1200."""
    evaluated, weighed = [], edge_profile._weighed
    monkeypatch.setattr(
        edge_profile, "_weighed", lambda a, *b: evaluated.append(len(a)) or weighed(a, *b)
    )
    profiles(*stubborn())
    assert len(evaluated) > 30
    assert sum(evaluated) < 20 * 12 + 60


def test_it_is_known_how_each_pixel_moves_an_edge():
    """To first order; pixels without weight do not."""
    seen, weight = stubborn()
    seen, weight = np.delete(seen, 3, axis=0), np.delete(weight, 3, axis=0)
    weight[:, 20] = 0.0
    gain = profiles(seen, weight).gain
    for pixel in (3, 11, 13, 20):
        step = 1e-4 * (np.arange(25) == pixel)
        ahead, back = (profiles(seen + by, weight).edge for by in (step, -step))
        assert gain[:, pixel] == pytest.approx((ahead - back) / 2e-4, rel=0.1, abs=0.02)
    assert np.abs(gain).max() > 1.0
