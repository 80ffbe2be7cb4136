"""Quantiles and tests of hypotheses against printed tables and their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from sldvexp.statistics import chi_square_p_value, f_test, nested_f_test, student_factor, welch

TABLE_4_2 = {  # mu1, s1, n1, mu2, s2, n2, printed t', recomputed t'
    "phi1": (-1.076, 0.0025, 16, -1.077, 0.0632, 7, 0.0418, 0.0418),
    "phi2": (2.640, 0.0015, 16, 2.639, 0.0222, 7, 0.1546, 0.1191),
    "phi3": (2.003, 0.0025, 16, 2.018, 0.0586, 7, -0.6938, -0.6770),
    "x": (0.688, 0.0020, 16, 0.685, 0.0243, 7, 0.3248, 0.3262),
    "y": (0.510, 0.0020, 16, 0.497, 0.0214, 7, 1.6042, 1.6042),
    "z": (1.619, 0.0015, 16, 1.621, 0.0059, 7, -0.8844, -0.8844),
}


def test_student_factor_of_tables() -> None:
    np.testing.assert_allclose(
        student_factor(0.95, [1, 4, 10, np.inf]), [12.7062, 2.7764, 2.2281, 1.95996], atol=1e-4
    )
    assert student_factor(0.99, 6) == pytest.approx(3.707, abs=5e-4)  # Table 4.2


def test_student_factor_of_fractions_and_of_none() -> None:
    assert student_factor(0.9, 2.5) == pytest.approx(stats.t.ppf(0.95, 2.5))
    assert np.isnan(student_factor(0.95, 0))
    assert np.isnan(student_factor(0.95, np.nan))
    assert student_factor(0.95, [[3.0, 3.0]]).shape == (1, 2)


@pytest.mark.parametrize("name", TABLE_4_2)
def test_welch_of_table_4_2(name: str) -> None:
    mean1, s1, n1, mean2, s2, n2, _, recomputed = TABLE_4_2[name]
    test = welch(mean1, s1 / np.sqrt(n1), n1 - 1, mean2, s2 / np.sqrt(n2), n2 - 1, 0.99)
    assert test.statistic == pytest.approx(recomputed, abs=1e-4)
    assert np.floor(test.dof) == 6
    assert not test.reject
    c = s1**2 / n1 / (s1**2 / n1 + s2**2 / n2)  # Eqs 4.30 and 4.29
    dof = (n1 - 1) * (n2 - 1) / ((n2 - 1) * c**2 + (1 - c) ** 2 * (n1 - 1))
    assert test.dof == pytest.approx(dof, rel=1e-12)
    assert test.critical == pytest.approx(stats.t.ppf(0.995, dof))


def test_welch_of_samples() -> None:
    rng = np.random.default_rng(7)
    a, b = rng.normal(0, 1, 12), rng.normal(2, 3, 5)
    expected = stats.ttest_ind(a, b, equal_var=False)
    test = welch(a.mean(), stats.sem(a), 11, b.mean(), stats.sem(b), 4)
    assert test.statistic == pytest.approx(expected.statistic)
    assert test.dof == pytest.approx(expected.df)
    assert bool(test.reject) == (expected.pvalue < 0.05)


def test_welch_with_a_known_standard_error() -> None:
    test = welch([0.0, 0.0], 1.0, np.inf, [1.5, 4.0], 1.0, np.inf)
    assert np.all(np.isinf(test.dof))
    np.testing.assert_allclose(test.critical, 1.959964, atol=1e-6)
    np.testing.assert_array_equal(test.reject, [False, True])


def test_f_test_of_tables() -> None:
    test = f_test([7.0, 8.0], 1, 4, 0.95)
    np.testing.assert_allclose(test.critical, 7.71, atol=0.005)  # Eq 5.17
    np.testing.assert_array_equal(test.reject, [False, True])
    np.testing.assert_allclose(test.p_value, stats.f.sf([7.0, 8.0], 1, 4))


def test_f_test_with_known_noise_is_a_chi_square() -> None:
    test = f_test(2.5, 2, np.inf, 0.95)
    assert test.p_value == pytest.approx(stats.chi2.sf(5.0, 2))
    assert test.critical == pytest.approx(stats.chi2.ppf(0.95, 2) / 2)


def test_f_tests_together_are_those_alone() -> None:
    """Of pixels that share their degrees of freedom, and of such whose noise is known."""
    statistic = np.array([[1.0, 5.0], [9.0, 2.0], [3.0, 4.0]])
    numerator, denominator = np.array([1.0, 2.0]), np.array([[4.0], [np.inf], [0.0]])
    test = f_test(statistic, numerator, denominator, 0.95)
    for place in np.ndindex(3, 2):
        one = f_test(statistic[place], numerator[place[1]], denominator[place[0], 0], 0.95)
        for name in ("statistic", "p_value", "critical", "reject"):
            np.testing.assert_array_equal(getattr(test, name)[place], getattr(one, name))
        np.testing.assert_array_equal([d[place] for d in test.dof], one.dof)


def test_f_test_without_freedom_decides_nothing() -> None:
    test = f_test([np.nan, 100.0], 2, 0, 0.95)
    assert np.all(np.isnan(test.p_value))
    assert not test.reject.any()


def test_nested_models() -> None:
    """Against a regression written out: 30 samples, 2 of 5 parameters tested."""
    rng = np.random.default_rng(8)
    x, y = rng.normal(size=(30, 5)), rng.normal(size=30)
    sse = [np.linalg.lstsq(x[:, :k], y)[1][0] for k in (3, 5)]
    test = nested_f_test(sse[0], sse[1], 2, 25, 0.95)
    beta, *_ = np.linalg.lstsq(x, y)
    middle = np.linalg.inv(np.linalg.inv(x.T @ x)[3:, 3:])
    wald = beta[3:] @ middle @ beta[3:] / 2 / (sse[1] / 25)
    assert test.statistic == pytest.approx(wald)


def test_chi_square() -> None:
    np.testing.assert_allclose(
        chi_square_p_value([3.84146, 5.99146, 1.0], [1, 2, 0]), [0.05, 0.05, np.nan], atol=1e-5
    )
