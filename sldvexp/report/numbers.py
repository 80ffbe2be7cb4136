"""Numbers as text: as many digits as their bound supports."""

from __future__ import annotations

import math

SMALLEST, LARGEST = "the smallest", "the largest"
#: Results of which more is better, by the last part of their names; of all others less is.
MORE_IS_BETTER = (
    *("rcond", "linpack_rcond", "efficiency", "passed"),
    *("covered", "covered_in_all", "coverage"),
)


def first(result: str) -> str:
    """Tell which values of a result, such as ``point.rcond``, are the best.

    Examples
    --------
    >>> first("point.rcond"), first("point.sse")
    ('the largest', 'the smallest')
    """
    return LARGEST if result.split(".")[-1] in MORE_IS_BETTER else SMALLEST


def number(value: complex, digits: int = 4) -> str:
    """Write a real or complex number with `digits` significant digits.

    Examples
    --------
    >>> number(3.14159, 3), number(0.5 - 2j)
    ('3.14', '0.5-2i')
    """
    value = complex(value)
    if math.isnan(value.real):
        return "-"
    if value.imag == 0:
        return f"{value.real:.{digits}g}"
    return f"{value.real:.{digits}g}{value.imag:+.{digits}g}i"


def bound_text(bound: float) -> str:
    """Write a bound alone, with two digits.

    Examples
    --------
    >>> bound_text(0.2), bound_text(12.34)
    ('± 0.20', '± 12')
    """
    if not math.isfinite(bound) or bound <= 0:
        return "(no bound)"
    return f"± {bound:.{max(0, 1 - math.floor(math.log10(bound)))}f}"


def with_bound(value: complex, bound: float) -> str:
    """Write ``value ± bound``, rounded to two digits of the bound.

    Examples
    --------
    >>> with_bound(-0.07263, 0.1934)
    '-0.07 ± 0.19'
    """
    value = complex(value)
    if not math.isfinite(bound) or bound <= 0:
        return f"{number(value)} (no bound)" if bound != 0 else number(value)
    places = max(0, 1 - math.floor(math.log10(bound)))
    text = f"{value.real:.{places}f}"
    if value.imag:
        text += f" {'+' if value.imag >= 0 else '-'} {abs(value.imag):.{places}f}i"
    return f"{text} ± {bound:.{places}f}"
