"""Tables 5.1 to 5.6 and Eqs 5.16 to 5.18: printed, correct, and the convention of the print."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.check.printed import linpack_rcond, printed_f, printed_half_width, sample_std
from sldvexp.reconstruction import (
    Absolute,
    Combined,
    Contravariant,
    Model,
    PointVelocity,
    Reconstruction,
    Relative,
    Weights,
)
from sldvexp.statistics import nested_f_test

SIMULATED = np.array(  # Table 5.1
    [
        [-0.0056, 0.2293, 0.9733],
        [0.3525, 0.2493, 0.9020],
        [0.1813, 0.1362, 0.9739],
        [-0.1338, -0.0738, 0.9883],
        [0.3387, -0.0610, 0.9389],
    ]
)
SIMULATED_VELOCITY = np.array([49.1141, 46.3045, 49.3322, 48.9977, 47.5010])
MEASURED = np.array(  # Table 5.4
    [
        [-0.0095, 0.2203, 0.9754],
        [0.3488, 0.2398, 0.9060],
        [0.1771, 0.1265, 0.9760],
        [-0.1378, -0.0837, 0.9869],
        [0.3337, -0.0712, 0.9400],
    ]
)
MEASURED_VELOCITY = np.array(
    [
        -0.5531 + 0.5608j,
        -0.5576 + 0.5000j,
        -0.6094 + 0.5640j,
        -0.5462 + 0.4673j,
        -0.5387 + 0.4455j,
    ]
)

EQUAL = Weights.equal
METHODS: dict[int, Reconstruction] = {
    1: Absolute(rows="1,2,3", weights=EQUAL),
    2: Absolute(rows="1,2,3,4,5", weights=EQUAL),
    3: Absolute(rows="1,2,3,4,5", weights=EQUAL, model=Model.full),
    4: Relative(rows="2-1,3-1,4-1", weights=EQUAL),
    5: Relative(rows="2-1,3-1,4-1,5-1", weights=EQUAL),
    6: Combined(rows="1-5,2,4", weights=EQUAL),
}
#: Tables 5.5 and 5.6, and how far the four digits of the inputs let the recomputation differ.
PRINTED_VELOCITY = {
    1: ([-0.1515 - 0.0464j, 0.2943 - 0.1225j, -0.6350 + 0.6021j], 0.003),
    2: ([-0.0726 - 0.0288j, -0.0836 + 0.3010j, -0.5681 + 0.5078j], 0.003),
    3: ([-0.1519 + 0.1345j, -0.1040 + 0.3429j, -1.1830 + 1.7743j], 0.01),
    4: ([-0.2755 + 0.1650j, 0.0427 + 0.3066j, -1.3460 + 1.8146j], 0.01),
    5: ([-0.1770 + 0.1407j, -0.0423 + 0.3276j, -1.0833 + 1.7496j], 0.01),
    6: ([-0.0736 - 0.0416j, -0.0668 + 0.2866j, -0.5694 + 0.4920j], 0.003),
}
PRINTED_RCOND = {  # as strings: the digits are what matters
    "simulated": ["0.0380", "0.0159", "5.2866e-05", "0.0655", "0.0028", "0.2037"],
    "measured": ["0.0381", "0.0161", "5.3002e-05", "0.0657", "0.0028", "0.2041"],
}
TRUE_RCOND = {
    "simulated": ["0.0295", "0.0129", "4.85e-05", "0.0498", "0.0024", "0.1604"],
    "measured": ["0.0297", "0.0132", "4.90e-05", "0.0496", "0.0025", "0.1610"],
}
DIRECTIONS = {"simulated": SIMULATED, "measured": MEASURED}
CASES = [(data, method) for data in DIRECTIONS for method in METHODS]


def half_digit(printed: str) -> float:
    """Half a unit in the last printed place."""
    mantissa, _, exponent = printed.partition("e")
    return 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def measured(method: int) -> PointVelocity:
    return METHODS[method].reconstruct(MEASURED, MEASURED_VELOCITY)


@pytest.mark.parametrize("method", METHODS)
def test_simulated_velocity_is_recovered(method: int) -> None:
    """Exactly from exact data, and from the table's within what its four digits allow."""
    exact = METHODS[method].reconstruct(SIMULATED, SIMULATED @ [2, 2, 50])
    np.testing.assert_allclose(exact.velocity[0, :, 0], [2, 2, 50], atol=1e-10)
    result = METHODS[method].reconstruct(SIMULATED, SIMULATED_VELOCITY)
    rounding = 0.5e-4 * (1 + 2 + 2 + 50)  # of a view's velocity and, times V, of its cosines
    allowed = rounding * np.abs(result.system.fit(slice(None)).solution[0, :3]).sum(axis=1)
    assert np.all(np.abs(result.velocity[0, :, 0] - [2, 2, 50]) < allowed)
    assert allowed.max() < 0.3


@pytest.mark.parametrize("method", METHODS)
def test_measured_velocity(method: int) -> None:
    printed, tolerance = PRINTED_VELOCITY[method]
    found = measured(method).velocity[0, :, 0]
    for part in (np.real, np.imag):
        np.testing.assert_allclose(part(found), part(printed), atol=tolerance)


def test_measured_intercept() -> None:
    intercept = measured(3).intercept
    assert intercept is not None
    assert intercept[0, 0] == pytest.approx(0.6015 - 1.2390j, abs=0.003)


@pytest.mark.parametrize(
    ("method", "sse", "std"), [(2, 0.0034, 0.0293), (3, 0.0012, 0.0171), (5, 0.0019, 0.0232)]
)
def test_sse_and_sample_std(method: int, sse: float, std: float) -> None:
    result = measured(method)
    residuals = result.residuals()[:, 0, 0]
    assert result.sse[0, 0] == pytest.approx(np.sum(np.abs(residuals) ** 2), rel=1e-12)
    assert result.sse[0, 0] == pytest.approx(sse, abs=0.5e-4)
    # One unit in the last place: half for the print, half for the inputs' own rounding.
    assert sample_std(residuals) == pytest.approx(std, abs=1e-4)


@pytest.mark.parametrize("method", [1, 4, 6])
def test_three_rows_leave_no_residual(method: int) -> None:
    assert np.abs(measured(method).residuals()).max() < 1e-14
    assert measured(method).noise_from == "views"


@pytest.mark.parametrize(("data", "method"), CASES)
def test_true_rcond(data: str, method: int) -> None:
    found = METHODS[method].reconstruct(DIRECTIONS[data], MEASURED_VELOCITY).rcond[0]
    printed = TRUE_RCOND[data][method - 1]
    assert found == pytest.approx(float(printed), abs=half_digit(printed))


@pytest.mark.parametrize(("data", "method"), CASES)
def test_printed_rcond_is_linpacks_estimate(data: str, method: int) -> None:
    """Within the printed digit and what rounding the cosines to four digits can change."""
    directions = DIRECTIONS[data]

    def estimate(cosines: np.ndarray) -> float:
        return linpack_rcond(METHODS[method].reconstruct(cosines, MEASURED_VELOCITY).matrix[0])

    step, rounding = 1e-6, 0.5e-4
    found = estimate(directions)
    changes = [estimate(directions + step * np.eye(15)[k].reshape(5, 3)) - found for k in range(15)]
    by_rounding = rounding / step * np.sum(np.abs(changes))
    printed = PRINTED_RCOND[data][method - 1]
    allowed = half_digit(printed)
    assert found == pytest.approx(float(printed), abs=allowed + by_rounding)
    assert by_rounding < 0.015 * found  # the allowance must not hide another convention
    if (data, method) not in {("simulated", 3), ("measured", 3), ("simulated", 4)}:
        assert found == pytest.approx(float(printed), abs=allowed)


def test_estimate_differs_from_truth_as_stated() -> None:
    ratios = [
        linpack_rcond(matrix) * np.linalg.cond(matrix, 1)
        for data, method in CASES
        for matrix in METHODS[method].reconstruct(DIRECTIONS[data], MEASURED_VELOCITY).matrix
    ]
    assert min(ratios) == pytest.approx(1.08, abs=0.01)
    assert max(ratios) == pytest.approx(1.33, abs=0.01)


@pytest.mark.parametrize(
    ("directions", "printed"),
    [
        (
            SIMULATED,
            [[-3.0627, 4.5905, -0.0717], [2.3190, 4.6467, -1.0818], [0.9131, -8.8920, 2.1003]],
        ),
        (  # Eq 5.16
            MEASURED,
            [[-3.0494, 4.5969, -0.0425], [2.3392, 4.6492, -1.0272], [0.8760, -8.9096, 2.0205]],
        ),
    ],
)
def test_contravariant_basis(directions: np.ndarray, printed: list[list[float]]) -> None:
    result = Contravariant(rows="1,2,3").reconstruct(directions, MEASURED_VELOCITY)
    assert result.basis is not None
    basis = result.basis[0]
    np.testing.assert_allclose(basis, printed, atol=0.01)
    np.testing.assert_allclose(basis @ directions[:3].T, np.eye(3), atol=1e-13)  # Eq 5.13
    velocity = np.einsum("j,ji->i", MEASURED_VELOCITY[:3], basis)  # Eq 5.14
    np.testing.assert_allclose(result.velocity[0, :, 0], velocity, atol=1e-13)


def test_f_of_the_intercept_in_both_conventions() -> None:
    partial, full = measured(2), measured(3)
    assert printed_f(0.0034, 0.0012, 0.0171) == pytest.approx(7.523, abs=1e-3)
    right = nested_f_test(partial.sse[0, 0], full.sse[0, 0], 2, 2, 0.95)
    assert right.statistic == pytest.approx(1.93, abs=0.005)
    test = full.intercept_test
    assert test is not None
    assert test.statistic[0, 0] == pytest.approx(right.statistic, rel=1e-9)
    assert (test.dof[0].item(), test.dof[1].item()) == (2, 2)
    assert not test.reject.any()


def test_half_widths_in_both_conventions() -> None:
    result = measured(2)
    v_ii = np.diag(np.linalg.inv(MEASURED.T @ MEASURED))
    s = sample_std(result.residuals())
    np.testing.assert_allclose(printed_half_width(s, v_ii), [0.3238, 0.6242, 0.0213], atol=1e-4)
    np.testing.assert_allclose(result.confidence[0, :, 0], [0.1934, 0.2685, 0.0496], atol=1e-4)
    assert result.dof[0] == 4


def test_efficiency_shows_what_three_rows_cost() -> None:
    assert measured(2).efficiency[0, :, 0] == pytest.approx(1)
    assert np.all(measured(1).efficiency < 0.4)
    np.testing.assert_allclose(measured(6).efficiency[0, :, 0], [0.97, 0.98, 0.57], atol=0.01)


def test_best_rows_are_better_conditioned_than_the_tables() -> None:
    best = Combined().reconstruct(MEASURED, MEASURED_VELOCITY)
    assert best.rcond[0] > 0.16 + 0.1
    best = Absolute(rows="best").reconstruct(MEASURED, MEASURED_VELOCITY)
    assert str(best.rows) == "1,4,5"
