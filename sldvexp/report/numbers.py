"""Numbers as text: as many digits as their bound supports."""

from __future__ import annotations

import math
from collections.abc import Iterable

from sldvexp.lazy import xarray as xr

#: Size in a shown unit below which a number is rounding alone: no instrument sees a picometre.
NOTHING = 1e-9
#: Decimals of places in mm, and of angles in deg.
PLACES = 2
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


def shown(value: float, digits: int = 3) -> str:
    """Write a number of a shown unit, such as mm/s, microstrain or mm; 0 if it is rounding alone.

    Examples
    --------
    >>> shown(1.388e-14), shown(0.5)
    ('0', '0.5')
    """
    return number(0.0 if abs(value) < NOTHING else value, digits)


def place_text(place: Iterable[float]) -> str:
    """Write coordinates in mm, to a hundredth.

    Examples
    --------
    >>> place_text([1.388e-14, -104.99999, 1234.56])
    '0, -105, 1234.56'
    """
    return ", ".join(f"{round(float(x), PLACES) + 0.0:.15g}" for x in place)


def angle_text(angle: float, bound: float) -> str:
    """Write an angle with its bound, deg: rounded to two digits of that, or to a hundredth.

    Examples
    --------
    >>> angle_text(88.517263, 4.95), angle_text(30.0000012, 2e-7)
    ('88.5 ± 5.0', '30.00 ± 0.01')
    """
    least = 10.0**-PLACES
    if bound < 10 * least:  # which no bound, NaN, is not
        return f"{angle:.{PLACES}f} ± {least:g}"
    return with_bound(angle, bound)


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
    text = f"{round(value.real, places) + 0.0:.{places}f}"  # no minus before zeros
    if value.imag:
        text += f" {'+' if value.imag >= 0 else '-'} {abs(value.imag):.{places}f}i"
    return f"{text} ± {bound:.{places}f}"


def bounds_of(data: xr.Dataset, name: str, kind: str = "confidence") -> xr.DataArray:
    """Find the bounds of a variable, NaN where none are given.

    Parameters
    ----------
    kind : str
        What the name of the bounds ends with.

    Examples
    --------
    >>> bounds_of(xr.Dataset({"origin": ("axis", [0, 1])}), "origin").values
    array([nan, nan])
    """
    # A place may be given in whole metres, and no integer says that there is no bound.
    return data.get(f"{name}_{kind}", xr.full_like(data[name], math.nan, dtype=float))
