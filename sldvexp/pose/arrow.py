"""Least squares over many views that share unknowns: a block-arrow matrix.

Every view v has unknowns a_v of its own, all have the unknowns c in common. With residuals r_v, and
their derivatives A_v by the own and C_v by the common unknowns, the normal equations are::

    [ A_1'A_1                A_1'C_1     ] [ a_1 ]     [ A_1'r_1     ]
    [            ...          ...        ] [ ... ] = - [  ...        ]
    [ C_1'A_1    ...      sum_v C_v'C_v  ] [  c  ]     [ sum C_v'r_v ]

The own unknowns are eliminated view by view. What is left for the common ones is the Schur
complement ``S = sum_v C_v'C_v - C_v'A_v (A_v'A_v)^-1 A_v'C_v``, whose inverse is their covariance.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array

#: Information in the worst direction, as a part of that with all else known: rounding errors below,
#: of a block and of the Schur complement, which is a difference.
UNDETERMINED, UNDETERMINED_SCHUR = 1e-14, 1e-12


@dataclass(frozen=True, eq=False)
class Arrow:
    """A block-arrow information matrix.

    Parameters
    ----------
    own : sequence of ndarray, shapes (p_v, p_v)
        ``A_v'A_v``, with the priors of the own unknowns.
    mixed : sequence of ndarray, shapes (p_v, q)
        ``A_v'C_v``.
    common : ndarray, shape (q, q)
        ``sum_v C_v'C_v``, with the priors of the common unknowns.
    """

    own: Sequence[Array]
    mixed: Sequence[Array]
    common: Array

    def damped(self, damping: float) -> Arrow:
        """With its diagonal larger by a part of it, as Levenberg and Marquardt do."""

        def larger(block: Array) -> Array:
            return block + damping * np.diag(np.diag(block))

        return Arrow([larger(a) for a in self.own], self.mixed, larger(self.common))

    def solve(self, own: Sequence[Array], common: Array) -> tuple[list[Array], Array]:
        """Own and common unknowns for right-hand sides of shapes (p_v,) and (q,)."""
        pulls = self._pulls()
        left = common - sum(p.T @ r for p, r in zip(pulls, own, strict=True))
        c = _solve(self._schur(pulls), left)
        each = zip(self.own, own, pulls, strict=True)
        return [_solve(a, r) - p @ c for a, r, p in each], c

    def covariance(self) -> Array:
        """Inverse of the whole matrix, all own unknowns in the order of the views, then the common.

        Two views correlate by what they have in common only:
        ``cov(a_v, a_w) = P_v S^-1 P_w'`` with ``P_v = (A_v'A_v)^-1 A_v'C_v``.
        """
        common = np.linalg.inv(self._schur(self._pulls()))
        # How far each unknown follows the common ones: a_v = -P_v c.
        follows = np.concatenate([*(-p for p in self._pulls()), np.eye(len(common))])
        whole = follows @ common @ follows.T
        for place, block in zip(self.places(), self.own, strict=True):
            whole[place, place] += np.linalg.inv(block)
        return np.asarray((whole + whole.T) / 2)

    def places(self) -> list[slice]:
        """Where each view's own unknowns stand among all."""
        ends = itertools.accumulate((len(a) for a in self.own), initial=0)
        return [slice(a, b) for a, b in itertools.pairwise(ends)]

    @property
    def size(self) -> int:
        """Number of all unknowns."""
        return sum(len(a) for a in self.own) + len(self.common)

    def determined(self) -> bool:
        """Whether the views and priors determine every unknown."""
        if any(share.any() for share in self.undetermined_own()):
            return False
        return not self.undetermined_common().any()

    def undetermined_own(self) -> list[Array]:
        """Of each view, the own unknowns' shares in a direction that nothing determines, or zero.

        The common unknowns are taken as known.
        """
        return [_worst(a, np.diag(a), UNDETERMINED) for a in self.own]

    def undetermined_common(self) -> Array:
        """Shares of the common unknowns in a direction that no view determines, or zeros."""
        schur = self._schur(self._pulls())
        return _worst(schur, np.diag(self.common), UNDETERMINED_SCHUR)

    def _pulls(self) -> list[Array]:
        return [_solve(a, m) for a, m in zip(self.own, self.mixed, strict=True)]

    def _schur(self, pulls: Sequence[Array]) -> Array:
        return self.common - sum(m.T @ p for m, p in zip(self.mixed, pulls, strict=True))


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right), np.float64)


def _worst(information: Array, known: Array, least: float) -> Array:
    """Absolute components of the worst direction, relative to the diagonal `known`; or zeros."""
    scale = np.sqrt(np.where(known > 0, known, 1.0))
    value, vector = np.linalg.eigh(information / np.outer(scale, scale))
    if not len(value) or value[0] > least:
        return np.zeros(len(value))
    return np.abs(vector[:, 0])
