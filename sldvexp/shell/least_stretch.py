"""Motion of the middle surface along itself that a closed shell makes when its walls bend.

Where a tube becomes oval its circles keep their length: beside w it moves around, by
``u,s = -k w``. Stretching a thin wall takes so much more force than bending it that u and v follow
w as those do which take the least energy of stretch,

    minimise over u, v:   int (e_11^2 + e_22^2 + 2 nu e_11 e_22 + 2 (1 - nu) e_12^2) dA ,

with the strains e of the middle surface, for a given w (Rayleigh 1881; Love 1888). Inertia of the
motion along the surface is left out; it matters where waves of stretch are as long as the shell. In
splines u and v of the same kind as w the energy is ``c' K c``, and

    c_uv = T c_w,      T = -K_uv,uv^-1 K_uv,w .

What u0 and v0 are beside T w costs energy of its own, nothing of it together with w's: a prior by
this energy shrinks it, and leaves free what ends that are held or loaded do to a shell, since that
stretches the inside least. A shell that is open along both directions need not follow at all.
"""

from __future__ import annotations

import numpy as np

from sldvexp.shell.chart import Chart
from sldvexp.shell.love import ThinShell, WallStretch
from sldvexp.shell.splines import Splines, TensorSplines
from sldvexp.typing import Array

#: Gauss points in a cell along each direction.
POINTS = 4
#: Stiffness that holds rigid motions, over the mean one.
HELD = 1e-10


def wall_stretch(
    chart: Chart, bending: TensorSplines, membrane: TensorSplines, nu: float
) -> WallStretch:
    """Find how u0 and v0 follow w, and what it takes to stretch the surface otherwise.

    Parameters
    ----------
    bending, membrane : TensorSplines
        Of w, and of u0 and v0.
    nu : float
        Poisson's ratio.

    Examples
    --------
    A tube of 0.1 m that becomes oval as cos 2 phi: around it moves by half as much, and not along.

    >>> import numpy as np
    >>> from sldvexp.geometry import Meridian
    >>> from sldvexp.shell import RevolutionChart, TensorSplines
    >>> tube = Meridian(np.array([[0.1, -0.1], [0.1, 0.1]]))
    >>> chart = RevolutionChart(np.zeros(3), np.eye(3), tube)
    >>> high = np.array([chart.period / 2, 0.1])
    >>> splines = TensorSplines.over(-high, high, 16, 5, 0.1, around=True)
    >>> place = np.random.default_rng(0).uniform(-high, high, (400, 2))
    >>> w = np.linalg.lstsq(splines(place), np.cos(2 * place[:, 0] / 0.1))[0]
    >>> found = wall_stretch(chart, splines, splines, 0.3)
    >>> u, v = ((splines(place) @ of) @ w for of in found.following)
    >>> half = np.sin(2 * place[:, 0] / 0.1) / 2
    >>> bool(np.abs(u + half).max() < 1e-3), bool(np.abs(v).max() < 1e-3)
    (True, True)
    """
    n, m = bending.count, membrane.count
    stiff = stretch_energy(chart, bending, nu)
    own, crossed = stiff[: 2 * n, : 2 * n], stiff[: 2 * n, 2 * n :]
    held = HELD * np.trace(own) / (2 * n) * np.eye(2 * n)
    following = -np.linalg.solve(own + held, crossed).reshape(2, n, n)
    return WallStretch(following, stretch_energy(chart, membrane, nu)[: 2 * m, : 2 * m])


def stretch_energy(chart: Chart, splines: TensorSplines, nu: float) -> Array:
    """Integrate the energy of stretch over the surface: K, of the coefficients of u, v and w."""
    place, weight = _gauss(splines)
    area = weight / np.abs(np.linalg.det(chart.forms(place).rate))
    ss, tt, st = ThinShell(splines, splines, chart).strain(place, 0.0)
    parts = ((1 - nu, ss), (1 - nu, tt), (nu, ss + tt), (2 * (1 - nu), st))
    return np.asarray(sum(factor * e.T @ (area[:, None] * e) for factor, e in parts))


def _gauss(splines: TensorSplines) -> tuple[Array, Array]:
    """Lay Gauss points over all cells: places, (point, 2), m, and weights, m^2."""
    node, weight = np.polynomial.legendre.leggauss(POINTS)

    def along(of: Splines) -> tuple[Array, Array]:
        width = np.diff(of.ends)[:, None]
        x = of.ends[:-1, None] + width * (node + 1) / 2
        return splines.unit * x.ravel(), splines.unit * (width * weight / 2).ravel()

    (s, of_s), (t, of_t) = along(splines.along_s), along(splines.along_t)
    place = np.stack(np.meshgrid(s, t, indexing="ij"), axis=-1).reshape(-1, 2)
    return place, np.outer(of_s, of_t).ravel()
