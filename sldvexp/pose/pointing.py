"""Pointing noise of the mirrors, found in scanned edges as a variance component.

An edge's stated standard error comes from the noise of velocities. Mirrors that do not come to rest
where they are sent move every edge besides, whatever its velocities say, so that its variance is
``std^2 + pointing^2``. The ellipses tell how much: with distances d of the edges from them along
the scan lines, derivatives X by the ellipses' numbers, ``w = 1 / (std^2 + pointing^2)`` and
``P = w - w X (X' w X)^-1 X' w``, restricted maximum likelihood finds where

    sum (P d)^2 = tr P,

and nothing if the stated errors explain the distances. An ellipse has its numbers for itself, so
that a wrong calibration, which moves and bends whole ellipses, is not taken for noise: it shows in
what the object then leaves of them (`lack_of_fit`).

Noise is taken as independent from edge to edge and normal. Drift, hysteresis that is the same along
a whole circle and a zero error that all edges have in common move ellipses as a whole: residuals
cannot show them, and they are not included; only views that are scanned again tell.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.geometry import ConicFit
from sldvexp.geometry.conic import distance_jacobian, signed_distance
from sldvexp.image import ScanLineEdges, fit_circle, pinhole_edges
from sldvexp.laser import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.typing import Array

#: Probability below which residuals are not what errors explain.
UNLIKELY = 1e-4
#: Probability that circles which are alike are found to differ: 1 % in a session of five views.
FALSE_ALARM = 0.002
#: Standard deviation of edges that galvanometers in good order point at again, rad.
IN_GOOD_ORDER = 10e-6
#: Edges so many times as noisy as those of the view's median circle are named.
MUCH = 2.0
#: Rounds in which noise and rejected outliers settle, and how closely, relative to an edge's error.
ROUNDS, SETTLED = 20, 1e-3
#: Harmonics of a circle's turn that no ellipse has and that an edge hidden in part has.
HARMONICS = (3, 4)

#: A conic and its edges, as `fit_circle` gives them.
CircleFit = tuple[ConicFit, ScanLineEdges]


@dataclass(frozen=True, eq=False)
class EllipseResiduals:
    """Edges of one circle beside their ellipse.

    Parameters
    ----------
    distance : ndarray, shape (n,), DAC steps
        Along the scan lines.
    design : ndarray, shape (n, p)
        Derivatives of `distance` by the ellipse's numbers.
    std : ndarray, shape (n,), DAC steps
        Stated standard errors along the scan lines.
    turn : ndarray, shape (n,), rad
        Direction of each edge from the ellipse's centre.
    """

    distance: Array
    design: Array
    std: Array
    turn: Array

    def whitened(self, variance: float) -> tuple[Array, Array, Array]:
        """Solve for the ellipse with pointing noise of a variance.

        Returns
        -------
        weight : ndarray, shape (n,)
            Inverse variances.
        residual : ndarray, shape (n,)
            Over its standard deviation.
        base : ndarray, shape (n, p)
            Orthonormal columns that the ellipse's numbers span.
        """
        weight = 1.0 / (self.std**2 + variance)
        root = np.sqrt(weight)
        base, _ = np.linalg.qr(root[:, None] * self.design)
        residual = root * self.distance
        return weight, residual - base @ (base.T @ residual), base

    @cached_property
    def span(self) -> Array:
        """Orthonormal columns that the ellipse's numbers span where all errors are alike."""
        return np.asarray(np.linalg.qr(self.design)[0])

    def excess(self, variance: float) -> float:
        """Compute ``sum (P d)^2 - tr P`` with pointing noise of a variance."""
        weight = 1.0 / (self.std**2 + variance)
        weighed = weight[:, None] * self.span
        sides = np.empty((weighed.shape[1], 1 + weighed.shape[1]))
        sides[:, 0], sides[:, 1:] = weighed.T @ self.distance, weighed.T @ weighed
        solved = np.linalg.solve(self.span.T @ weighed, sides)
        left = weight * self.distance - weighed @ solved[:, 0]
        return float(left @ left - weight.sum() + solved[:, 1:].trace())

    @property
    def freedom(self) -> int:
        """Degrees of freedom."""
        return self.design.shape[0] - self.design.shape[1]

    def square(self, variance: float) -> float:
        """Sum the squared residuals over their variances."""
        return float(np.sum(self.whitened(variance)[1] ** 2))

    def typical(self, variance: float) -> float:
        """Average standard deviations as weights do, DAC steps."""
        return float(np.mean(1.0 / (self.std**2 + variance)) ** -0.5)

    def with_harmonics(self) -> EllipseResiduals:
        """Let the edges bend in ways that no ellipse does."""
        bent = [f(k * self.turn) for k in HARMONICS for f in (np.cos, np.sin)]
        return replace(self, design=np.column_stack([self.design, *bent]))


@dataclass(frozen=True, eq=False)
class Pointing:
    """Pointing noise of one view.

    Parameters
    ----------
    std : ndarray, shape (circle,), DAC steps
        In the order of the edges that it was found in; alike unless the circles differ.
    noise : ndarray, shape (circle,), DAC steps
        Standard error of a typical edge along its scan line, stated and of pointing.
    dof : float
        Degrees of freedom behind the edges' variance, after Satterthwaite.
    chi_square, freedom : float
        Of the ellipses, with pointing noise: sum of squared residuals over their variances.
    stated : float
        Probability of larger residuals if the stated errors were all.
    differ : float
        Probability of circles that differ as much if all had the same noise.
    bent : ndarray, shape (circle,)
        Probability, for each circle, of edges that bend as far from the ellipse if all were noise.
    """

    std: Array
    noise: Array
    dof: float
    chi_square: float
    freedom: float
    stated: float
    differ: float
    bent: Array

    @property
    def whole(self) -> float:
        """Pointing noise of the view, DAC steps: root mean square of its circles."""
        return float(np.sqrt(np.mean(self.std**2)))


def widen_edges(edges: Sequence[ScanLineEdges], std: Array) -> list[ScanLineEdges]:
    """Add pointing noise of each circle, DAC steps, to the errors of its edges in DAC steps."""
    return [replace(e, std=np.hypot(e.std, s)) for e, s in zip(edges, std, strict=True)]


#: Views whose ellipses are kept.
VIEWS_KEPT = 32


def find_pointing(
    edges: Sequence[ScanLineEdges], laser: TwoMirror
) -> tuple[Pointing, list[CircleFit]]:
    """Find the pointing noise of one view's edges, with the ellipses that it makes.

    Ellipses are fitted in pinhole coordinates. One noise is taken for all circles, unless the
    scatter of residuals differs between them (Levene's test, which minds heavy tails less than the
    likelihood ratio does), as where the beam is not well focused on some (Figure 4.27). Circles
    that do not differ from each other go on sharing theirs: few edges tell one's own badly.

    Parameters
    ----------
    edges : sequence of ScanLineEdges
        Of the circles in any order, DAC steps.

    Raises
    ------
    UserError
        If the edges of a circle make no ellipse.
    """
    found, fits = _of_view(EdgesAndLaser(_digest(edges, laser), edges, laser))
    return found, list(fits)


@dataclass(frozen=True)
class EdgesAndLaser:
    """Edges of a view and the laser, known by their digest."""

    digest: bytes
    edges: Sequence[ScanLineEdges] = field(compare=False)
    laser: TwoMirror = field(compare=False)


def _digest(edges: Sequence[ScanLineEdges], laser: TwoMirror) -> bytes:
    """Compute a digest of all that decides the noise and the ellipses."""
    told = hashlib.sha256(repr(laser).encode())
    for each in edges:
        for f in fields(each):
            value = getattr(each, f.name)
            is_array = isinstance(value, np.ndarray)
            content = value.tobytes() if is_array else repr(value).encode()
            told.update(f"{f.name} {value.shape if is_array else ''} {len(content)} ".encode())
            told.update(content)
    return told.digest()


@lru_cache(maxsize=VIEWS_KEPT)
def _of_view(content: EdgesAndLaser) -> tuple[Pointing, list[CircleFit]]:
    """Find both; methods that are compared, and runs of a sweep over them, have them in common."""
    edges, laser = content.edges, content.laser
    groups = [list(range(len(edges)))]
    std, fits, residuals = _settle(edges, laser, groups)
    differ = _levene(residuals, pointing_variance(residuals))
    if differ < FALSE_ALARM:
        groups = _split(groups[0], residuals)
        std, fits, residuals = _settle(edges, laser, groups)
    return _describe(residuals, std, groups, differ), fits


def _settle(
    edges: Sequence[ScanLineEdges], laser: TwoMirror, groups: Sequence[Sequence[int]]
) -> tuple[Array, list[CircleFit], list[EllipseResiduals]]:
    """Fit ellipses and find noise until both, and the outliers, agree.

    Returns
    -------
    std : ndarray, shape (circle,), DAC steps
        Noise of each, common to the circles of a group.
    fits, residuals
        Of each circle.
    """
    # Outliers are first told with equal weights: noise that is not known yet makes outliers of
    # edges that state small errors.
    typical = float(np.median(np.concatenate([e.std for e in edges])))
    tried = [replace(e, std=np.full_like(e.std, typical)) for e in edges]
    std = np.full(len(edges), np.inf)
    for _ in range(ROUNDS):
        given = [pinhole_edges(laser, e) for e in tried]
        fits = [fit_circle(e) for e in given]
        each = zip(edges, tried, given, fits, strict=True)
        residuals = [_beside_ellipse(stated, e, seen, *fit) for stated, e, seen, fit in each]
        before, std = std, np.empty(len(edges))
        for group in groups:
            std[group] = np.sqrt(pointing_variance([residuals[k] for k in group]))
        if np.all(np.abs(std - before) <= SETTLED * np.hypot(std, typical)):
            break
        tried = widen_edges(edges, std)
    return std, fits, residuals


def _beside_ellipse(
    stated: ScanLineEdges,
    tried: ScanLineEdges,
    given: ScanLineEdges,
    fit: ConicFit,
    moved: ScanLineEdges,
) -> EllipseResiduals:
    """Take the distances of edges that are no outliers, from across the edge to along the line.

    Parameters
    ----------
    stated, tried, given
        As measured, with the errors that are tried, and the latter in pinhole coordinates.
    fit, moved
        Of the given ones. What a wide spot adds to their errors is no distance.
    """
    numbers = fit.ellipse.parameters
    _, normal = signed_distance(moved.position, numbers)
    across = (fit.residual_std / tried.std * (given.std / moved.std))[:, None]
    y, x = (moved.position - fit.ellipse.centre).T[::-1]
    found = EllipseResiduals(
        fit.residual / across[:, 0],
        distance_jacobian(normal, numbers) / across,
        stated.std,
        np.arctan2(y, x),
    )
    return EllipseResiduals(*(getattr(found, n)[fit.used] for n in found.__dataclass_fields__))


def _split(group: list[int], residuals: Sequence[EllipseResiduals]) -> list[list[int]]:
    """Part circles, where their noise differs most, until those that share one are alike."""
    own = [residuals[k] for k in group]
    if len(group) == 1 or _levene(own, pointing_variance(own)) >= FALSE_ALARM:
        return [group]
    noise = np.array([r.typical(pointing_variance([r])) for r in own])
    order = np.argsort(noise)
    cut = int(np.argmax(np.diff(np.log(noise[order])))) + 1
    quiet, noisy = ([group[k] for k in part] for part in (order[:cut], order[cut:]))
    return [*_split(quiet, residuals), *_split(noisy, residuals)]


def pointing_variance(residuals: Sequence[EllipseResiduals]) -> float:
    """Solve ``sum (P d)^2 = tr P`` for the variance that all these ellipses' edges have besides.

    Returns
    -------
    float, squared DAC steps
        Zero if the stated errors explain the distances.
    """

    def excess(variance: float) -> float:
        return sum(r.excess(variance) for r in residuals)

    if excess(0.0) <= 0.0:
        return 0.0
    most = max(float(np.max(r.distance**2)) for r in residuals)
    while excess(most) > 0.0:
        most *= 2.0
    return float(scipy.optimize.brentq(excess, 0.0, most))


def _levene(residuals: Sequence[EllipseResiduals], variance: float) -> float:
    """Give the probability of sizes of residuals that differ as much between the circles."""
    sizes = []
    for r in residuals:
        _, residual, base = r.whitened(variance)
        free = 1.0 - (base**2).sum(axis=1)
        sizes.append(np.abs(residual) / np.sqrt(np.maximum(free, np.finfo(float).eps)))
    count = np.array([len(s) for s in sizes])
    means, inside = np.array([s.mean() for s in sizes]), sum(len(s) * s.var() for s in sizes)
    between = count @ (means - count @ means / count.sum()) ** 2
    p, q = len(sizes) - 1, count.sum() - len(sizes)
    return float(scipy.special.fdtrc(p, q, between / p / (inside / q))) if p and inside else 1.0


def _describe(
    residuals: Sequence[EllipseResiduals],
    std: Array,
    groups: Sequence[Sequence[int]],
    differ: float,
) -> Pointing:
    """Test the ellipses without pointing noise, and with it."""
    freedom = float(sum(r.freedom for r in residuals))
    before = sum(r.square(0.0) for r in residuals)
    return Pointing(
        std=std,
        noise=np.array([r.typical(s**2) for r, s in zip(residuals, std, strict=True)]),
        dof=_noise_dof(residuals, std, groups),
        chi_square=sum(r.square(s**2) for r, s in zip(residuals, std, strict=True)),
        freedom=freedom,
        stated=float(scipy.special.chdtrc(freedom, before)) if freedom else 1.0,
        differ=differ,
        bent=_bent(residuals, groups),
    )


def _bent(residuals: Sequence[EllipseResiduals], groups: Sequence[Sequence[int]]) -> Array:
    """Test harmonics of the turn that no ellipse has, with the noise that they leave of a group."""
    probability = np.ones(len(residuals))
    for group in groups:
        bent = [residuals[k].with_harmonics() for k in group]
        freedom = sum(b.freedom for b in bent)
        if min(b.freedom for b in bent) <= 0:
            continue
        variance = pointing_variance(bent)
        scale = max(sum(b.square(variance) for b in bent) / freedom, 1.0)
        for k, b in zip(group, bent, strict=True):
            added = b.design.shape[1] - residuals[k].design.shape[1]
            statistic = (residuals[k].square(variance) - b.square(variance)) / added / scale
            probability[k] = scipy.special.fdtrc(added, freedom, statistic)
    return probability


def _noise_dof(
    residuals: Sequence[EllipseResiduals], std: Array, groups: Sequence[Sequence[int]]
) -> float:
    """Count degrees of freedom behind the edges' variances, after Satterthwaite.

    A variance component errs by ``2 / tr(P P)``. A group of circles that has the part f of all
    weights moves the logarithm of the pose's covariance by about f of its own.
    """
    total, squares = 0.0, 0.0
    for group in groups:
        solved = [residuals[k].whitened(std[k] ** 2) for k in group]
        weight = np.concatenate([w for w, _, _ in solved])
        information = sum(_trace_of_square(w, base) for w, _, base in solved)
        dof = information / float(np.mean(weight)) ** 2
        total += float(np.sum(weight))
        squares += float(np.sum(weight)) ** 2 / dof if dof > 0 else np.inf
    return total**2 / squares


def _trace_of_square(weight: Array, base: Array) -> float:
    """Give ``tr(P P)`` of ``P = w^1/2 (1 - Q Q') w^1/2``."""
    root = np.sqrt(weight)
    p = root[:, None] * (np.eye(len(weight)) - base @ base.T) * root
    return float(np.sum(p**2))


def lack_of_fit(pointing: Sequence[Pointing], square: float, freedom: float) -> tuple[float, float]:
    """Compare what poses leave of some views' edges with what ellipses of their own leave.

    Parameters
    ----------
    square, freedom : float
        Sum of the poses' squared residuals over the edges' variances, its degrees of freedom.

    Returns
    -------
    statistic, probability : float
        F, and the probability of a larger one if the object and the mirrors are as they are said
        to be.
    """
    least, free = sum(p.chi_square for p in pointing), sum(p.freedom for p in pointing)
    more, added = square - least, freedom - free
    if added <= 0 or free <= 0:
        return np.nan, 1.0
    # Noise that is smaller than stated makes no misfit: the bounds rest on the stated one.
    statistic = more / added / max(least / free, 1.0)
    return statistic, float(scipy.special.fdtrc(added, free, max(statistic, 0.0)))


def mirror_findings(found: Mapping[str, Pointing], laser: TwoMirror) -> Iterator[Finding]:
    """Say once in which views the mirrors point worse than mirrors in good order do, and how much.

    Parameters
    ----------
    found : mapping of str to Pointing
        By the views' names.
    laser : TwoMirror
        Its ``pointing_std`` is expected, where it is said.
    """
    angle = float(laser.step.mean())
    expected = max(IN_GOOD_ORDER / angle, laser.pointing_std)
    shaky = {v: p for v, p in found.items() if p.stated < UNLIKELY and p.whole > expected}
    if not shaky:
        return
    sizes = sorted(p.whole for p in shaky.values())
    names = f"view{'s' if len(shaky) > 1 else ''} {', '.join(shaky)}"
    wide = f"{sizes[0]:.2g} to {sizes[-1]:.2g}" if len(shaky) > 1 else f"{sizes[0]:.2g}"
    yield Finding(
        "pointing",
        names,
        f"{names}: the edges scatter by {wide} DAC steps rms more than their noise explains, at "
        f"most {1e6 * angle * sizes[-1]:.2g} microrad or {1e3 * angle * sizes[-1]:.2g} mm at 1 m, "
        f"where mirrors in good order repeat within {1e6 * angle * expected:.2g}; edges are "
        "weighed accordingly, and the bounds have it in them",
        Severity.note,
        p_value=min(p.stated for p in shaky.values()),
        size=sizes[-1],
        views=tuple(shaky),
    )


def pointing_findings(view: str, found: Pointing, ellipse: Mapping[int, int]) -> Iterator[Finding]:
    """Say of a view's circles which are noisier than the others, and which are no ellipses.

    Parameters
    ----------
    ellipse : mapping of int to int
        Place of each circle in `found`, by its number.
    """
    where = f"view {view}"
    middle = float(np.median(found.noise))
    for number, place in ellipse.items():
        if found.differ < FALSE_ALARM and found.noise[place] > MUCH * middle:
            yield Finding(
                "noisy_circle",
                f"circle {number}",
                f"{where}: the edges of circle {number} scatter by {found.noise[place]:.2g} "
                f"DAC steps, those of the others by {middle:.2g}, as where the beam is not well "
                "focused; they are weighed accordingly",
                Severity.note,
                p_value=found.differ,
                size=float(found.noise[place]),
                views=(view,),
            )
        if found.bent[place] < UNLIKELY / len(ellipse):
            yield Finding(
                "edges",
                f"circle {number}",
                f"{where}: the edges of circle {number} lie beside its ellipse in a way that is no "
                "noise, and the bounds may be too small; circles that hide one another, or that "
                "move unevenly, look like this",
                Severity.doubtful,
                p_value=float(found.bent[place]),
                views=(view,),
            )
