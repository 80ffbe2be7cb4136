"""Poles of several references: a shape, and how much of it each place of excitation drives.

The residues of a pole are ``R_dk = sum_m phi_dm L_km`` of pixel d and reference k. One shape of a
pole makes a matrix of rank one; two modes that share their pole make one of rank two, which one
reference cannot show. Shapes of a pole of m modes are what m references, its pivots, drive:
their rows of L are those of the unit matrix, and all others are free,

    Y_dk(w) = i w sum_r [R_dk / (i w - l_r) + conj(R_dk) / (i w - conj(l_r))] + L_dk / (i w)
              + i w U_dk.

Modes beyond the band have residues of any rank.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.modes.model import poles_of, split
from sldvexp.typing import Array, ComplexArray, IndexArray


@dataclass(frozen=True, eq=False)
class SharedPole:
    """One pole and how its modes take part in the references.

    Parameters
    ----------
    value : complex, rad/s
    pivots : tuple of int
        References whose responses the shapes are, one for each mode of the pole.
    share : ndarray of complex, shape (reference, mode)
        The matrix L; the unit matrix in the rows of the pivots.
    """

    value: complex
    pivots: tuple[int, ...]
    share: ComplexArray

    @classmethod
    def from_rows(cls, value: complex, rows: ComplexArray) -> SharedPole:
        """Choose pivots for modes whose shares span some rows, shape (mode, reference)."""
        pivots = np.sort(scipy.linalg.qr(rows, mode="r", pivoting=True)[1][: len(rows)])
        share = np.linalg.solve(rows[:, pivots], rows).T
        return cls(value, tuple(int(k) for k in pivots), np.asarray(share))

    @property
    def modes(self) -> int:
        """How many modes share the pole."""
        return len(self.pivots)

    @property
    def free(self) -> list[tuple[int, int]]:
        """Places of L that are unknowns."""
        others = [k for k in range(len(self.share)) if k not in self.pivots]
        return [(k, m) for k in others for m in range(self.modes)]


@dataclass(frozen=True, eq=False)
class Participation:
    """All that is not linear in the model of several references.

    Parameters
    ----------
    poles : tuple of SharedPole
    beyond : ndarray of complex, shape (other,), rad/s
        Poles beside the band.
    """

    poles: tuple[SharedPole, ...]
    beyond: ComplexArray

    @property
    def pole(self) -> ComplexArray:
        """Pole of each mode, shape (mode,)."""
        return np.array([p.value for p in self.poles for _ in p.pivots], complex)

    @property
    def pole_of_mode(self) -> IndexArray:
        """Number of each mode's pole, shape (mode,)."""
        return np.repeat(np.arange(len(self.poles)), [p.modes for p in self.poles])

    @property
    def pivot(self) -> IndexArray:
        """Reference that each mode's shape is the response to, shape (mode,)."""
        return np.array([k for p in self.poles for k in p.pivots], int)

    @property
    def share(self) -> ComplexArray:
        """Shares of all modes, shape (reference, mode)."""
        return np.concatenate([p.share for p in self.poles], axis=1)

    @property
    def unknowns(self) -> Array:
        """All as one vector: ln w, then ln zeta of all poles; real, then imaginary free shares."""
        every = np.array([*(p.value for p in self.poles), *self.beyond], complex)
        free = np.array([p.share[place] for p in self.poles for place in p.free], complex)
        size = np.abs(every)
        parts = (np.log(size), np.log(-every.real / size), free.real, free.imag)
        return np.concatenate(parts)

    def share_std(self, covariance: Array) -> Array:
        """Take standard errors of shares from that of the unknowns, shape (reference, mode).

        Of the larger one of real and imaginary part; 0 of the pivots.
        """
        std, begin = np.zeros(self.share.shape), 2 * (len(self.poles) + len(self.beyond))
        error = np.sqrt(np.diag(covariance)[begin:].reshape(2, -1).max(axis=0))
        modes = np.cumsum([0, *(p.modes for p in self.poles)])
        places = [(k, modes[i] + m) for i, p in enumerate(self.poles) for k, m in p.free]
        for place, one in zip(places, error, strict=True):
            std[place] = one
        return std

    def at(self, unknowns: Array) -> Participation:
        """Give the same poles other values."""
        count = len(self.poles) + len(self.beyond)
        every = poles_of(np.exp(unknowns[:count]), np.exp(unknowns[count : 2 * count]))
        real, imaginary = unknowns[2 * count :].reshape(2, -1)
        free, begin, poles = real + 1j * imaginary, 0, []
        for pole, value in zip(self.poles, every, strict=False):
            share = pole.share.copy()
            for place in pole.free:
                share[place] = free[begin]
                begin += 1
            poles.append(replace(pole, value=complex(value), share=share))
        return Participation(tuple(poles), every[len(poles) :])

    def columns(self, omega: Array) -> Array:
        """Make the model's matrix: Re, Im of the shape of each mode in turn, then all that is free.

        Parameters
        ----------
        omega : ndarray, shape (line,), rad/s

        Returns
        -------
        ndarray, shape (2 reference line, coefficient)
            Rows of the real parts, reference by reference, then of the imaginary ones.
        """
        iw, found = 1j * omega, []
        for pole in self.poles:
            first, second = iw / (iw - pole.value), iw / (iw - np.conj(pole.value))
            found += [_pair(first, second, share) for share in pole.share.T]
        free: list[ComplexArray] = []
        for other in self.beyond:
            free += _free(iw / (iw - other), iw / (iw - np.conj(other)))
        below, above = omega.min() / iw, iw / omega.max()
        free += [below, 1j * below, above, 1j * above]
        each = np.kron(np.eye(len(self.poles[0].share)), np.stack(free, axis=1))
        return split(np.concatenate([*found, each], axis=1))

    def changes(self, omega: Array) -> Iterator[tuple[list[int], Array]]:
        """Differentiate the columns by each unknown.

        Yields
        ------
        list of int
            The columns that change.
        ndarray, shape (2 reference line, own column)
            How.
        """
        count, references = len(self.poles), len(self.poles[0].share)
        starts = 2 * np.cumsum([0, *(p.modes for p in self.poles)])
        per, begin = 2 * len(self.beyond) + 4, starts[-1]
        for by_damping in (False, True):
            for k, pole in enumerate(self.poles):
                first, second = _slopes(pole.value, omega, by_damping)
                blocks = [_pair(first, second, share) for share in pole.share.T]
                own = list(range(starts[k], starts[k + 1]))
                yield own, split(np.concatenate(blocks, axis=1))
            for k, value in enumerate(self.beyond):
                pair = np.stack(_free(*_slopes(value, omega, by_damping)), axis=1)
                own = [begin + per * r + 2 * k + j for r in range(references) for j in (0, 1)]
                yield own, split(np.asarray(np.kron(np.eye(references), pair), complex))
        iw = 1j * omega
        for turn in (1.0, 1j):
            for k in range(count):
                pole = self.poles[k]
                first, second = iw / (iw - pole.value), iw / (iw - np.conj(pole.value))
                for reference, mode in pole.free:
                    share = np.zeros(references, complex)
                    share[reference] = turn
                    place = starts[k] + 2 * mode
                    yield [place, place + 1], split(_pair(first, second, share))


def _free(first: ComplexArray, second: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Make the columns of Re R and Im R."""
    return first + second, 1j * (first - second)


def _pair(first: ComplexArray, second: ComplexArray, share: ComplexArray) -> ComplexArray:
    """Make the columns of Re and Im of a shape for all references, (reference line, 2)."""
    own, other = np.outer(share, first).ravel(), np.outer(share.conj(), second).ravel()
    return np.stack(_free(own, other), axis=1)


def _slopes(pole: complex, omega: Array, by_damping: bool) -> tuple[ComplexArray, ComplexArray]:
    """Differentiate ``i w / (i w - l)`` and that of the conjugate by ln w_r or ln zeta_r."""
    natural, damping = abs(pole), -pole.real / abs(pole)
    turned = natural * damping * (-1 - 1j * damping / np.sqrt(1 - damping**2))
    change, iw = (turned if by_damping else pole), 1j * omega
    return iw / (iw - pole) ** 2 * change, iw / (iw - np.conj(pole)) ** 2 * np.conj(change)
