"""Many sessions of one structure: errors of a shell's field, and how often its bounds hold.

Geometry and truth are those of `plate_strain` and `panel_strain`; every session has noise of its
own, and poses that are off by what edge scans leave. A session costs a second.

::

    python -m tests.shell.sessions plate 50
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.shell import Gage, Isotropic, estimate_surface
from sldvexp.shell.gage import along
from tests.shell import simulated_shell as lab

#: Standard errors of a pose that edge scans find: of its rotation, rad, and its origin, m.
ROTATION, ORIGIN = 15e-6, 27e-6
#: Of 95 % intervals.
LEVEL = 1.959964
QUANTITIES = ("u", "v", "w", "ss", "tt", "st")
#: Gages of experiment=gages.
GAGES = {
    "centre_0": Gage([0.0, 0.0], 0.0, 0.010),
    "centre_90": Gage([0.0, 0.0], 90.0, 0.010),
    "centre_45": Gage([0.0, 0.0], 45.0),
    "quarter_45": Gage([-0.075, -0.0625], 45.0),
    "quarter_135": Gage([-0.075, -0.0625], 135.0),
    "small": Gage([0.07, 0.075], 0.0, 0.003),
    "near_edge": Gage([-0.12, 0.0], 0.0),
    "at_edge": Gage([-0.134, 0.0], 0.0),
}
#: Those that lie more than 40 mm from the edges.
INNER = slice(0, 6)


@dataclass(frozen=True)
class Case:
    """A structure and how it is seen.

    Parameters
    ----------
    radius : float, m, optional
        Of a panel.
    frequency : float, Hz
    smaller : float
        By which thickness and stretch are divided.
    worse : float
        By which poses are worse.
    pixels : tuple of 2 int
        Of a view.
    stretch : float, m/s
        Of the lab's modes along the surface.
    in_phase : float, m/s
        Of the middle along itself in phase with the bending.
    """

    radius: float | None = None
    frequency: float = 197.0
    smaller: float = 1.0
    worse: float = 1.0
    pixels: tuple[int, int] = (39, 46)
    stretch: float = 0.2
    in_phase: float = 0.0


CASES = {
    "plate": Case(),
    "panel": Case(radius=0.5, frequency=439.0),
    "third": Case(smaller=3.0),
    "fifth": Case(smaller=5.0),
    "poses": Case(worse=20.0),
}
#: Motions of the middle in phase with the bending, from such that nobody finds to such that all do.
IN_PHASE = {f"in_phase_{um}": Case(in_phase=um * 1e-6) for um in (3, 9, 13, 19, 30, 45, 90)}


@dataclass(frozen=True, eq=False)
class Session:
    """Results of a session.

    Attributes
    ----------
    error : ndarray, shape (6,)
        Root mean square error of u, v, w and the strains, over that of the truth.
    bending : ndarray, shape (6,)
        The same of the part in phase with the bending, of the truth's.
    held : ndarray of bool, shape (6, part, place)
    gage_error, gage_bound : ndarray, shape (gage, part)
        Microstrain.
    """

    error: np.ndarray
    bending: np.ndarray
    held: np.ndarray
    gage_error: np.ndarray
    gage_bound: np.ndarray


def session(case: Case, seed: int, **settings) -> Session:
    """Simulate one and reconstruct it, with settings of the method."""
    truth = lab.plate(
        case.radius, case.stretch / case.smaller, 0.003 / case.smaller, in_phase=case.in_phase
    )
    rng = np.random.default_rng(1000 + seed)
    std = case.worse * np.tile([ROTATION] * 3 + [ORIGIN] * 3, len(lab.PLACES))
    errors = (std * rng.normal(size=len(std))).reshape(-1, 6)
    views = lab.views(truth, rng, case.pixels, frequency=(case.frequency,), errors=errors)
    sheet = replace(lab.SHEET, thickness=0.003 / case.smaller)
    found = estimate_surface(
        views,
        lab.LASER,
        lab.volume(case.radius),
        lab.method(**settings),
        sheet,
        frequency=[case.frequency],
        covariance=np.diag(std**2),
    )
    return compared(found, truth, case, sheet)


def compared(found, truth, case: Case, sheet: Isotropic) -> Session:
    """Hold a field against the truth, at the nodes of its surface."""
    place, face = found.fit.outline.corners, sheet.thickness / 2
    chart = found.fit.outline.chart
    points, frames = chart.points(place, face), chart.frames(place)
    velocity = np.einsum("pij,pj->pi", frames, truth.velocity(points, case.frequency))
    true = [*velocity.T, *truth.strain(points, case.frequency).T]
    found_there, std = _found(found, place, face, case.frequency)
    error, bending, held = [], [], []
    for i, (value, of_true) in enumerate(zip(found_there, true, strict=True)):
        off = value - of_true
        # Strain is the velocity's gradient over i omega.
        part = np.real if i < 3 else np.imag
        error.append(np.linalg.norm(off) / np.linalg.norm(of_true))
        bending.append(np.linalg.norm(part(off)) / np.linalg.norm(part(of_true)))
        held.append(np.abs([off.real, off.imag]) <= LEVEL * std[i])
    gages = _gages(found, truth, case.frequency, face)
    return Session(np.array(error), np.array(bending), np.array(held), *gages)


def _found(found, place, face, frequency):
    """Motion along the local axes and strains of the face, with standard errors by part."""
    fit = found.fit
    values, stds = [], []
    for rows in fit.shell.velocity(place, face):
        value, own, others = fit.evaluate(rows)
        values.append(value[:, 0])
        stds.append(np.sqrt(own + others)[..., 0])
    group = found.strain()
    for i in range(3):
        values.append(group["strain"].values[:, i, 0])
        stds.append(group["strain_std_by_part"].values[:, :, i, 0])
    return values, stds


def _gages(found, truth, frequency, face):
    """Errors and bounds of all gages, microstrain, shape (gage, part)."""
    fit = found.fit
    rows = np.stack([g.row(fit.shell, fit.face) for g in GAGES.values()])
    strain, variance = found.strain_of(rows, [g.row for g in GAGES.values()])
    true = []
    for gage in GAGES.values():
        places, weight = gage.points()
        local = truth.strain(fit.outline.chart.points(places, face), frequency)
        true.append(weight @ along(tuple(local.T), gage.along))
    off = strain[:, 0] - np.array(true)
    return 1e6 * np.stack([off.real, off.imag], -1), 1e6 * LEVEL * np.sqrt(variance[..., 0]).T


@dataclass(frozen=True, eq=False)
class Shares:
    """Shares of intervals that hold, over sessions.

    Attributes
    ----------
    mean : ndarray, shape (6, part)
    low_places : ndarray, shape (6, part)
        Share of places at which less than 80 % of the sessions hold.
    gages : float
        Share of all gages' parts.
    """

    mean: np.ndarray
    low_places: np.ndarray
    gages: float

    @classmethod
    def of(cls, sessions: list[Session]) -> Shares:
        by_place = np.mean([s.held for s in sessions], axis=0)
        gages = np.mean([np.abs(s.gage_error) <= s.gage_bound for s in sessions])
        return cls(by_place.mean(axis=-1), (by_place < 0.8).mean(axis=-1), float(gages))


def told(name: str, sessions: list[Session]) -> str:
    """Write figures of a case as a table."""
    shares = Shares.of(sessions)
    error, bending = (
        np.sqrt(np.mean([getattr(s, kind) ** 2 for s in sessions], axis=0))
        for kind in ("error", "bending")
    )
    lines = [f"{name}, {len(sessions)} sessions"]
    for i, quantity in enumerate(QUANTITIES):
        lines.append(
            f"{quantity:3} error {error[i]:.2%} bending {bending[i]:.2%} covered "
            f"{shares.mean[i, 0]:.3f} {shares.mean[i, 1]:.3f} low places "
            f"{shares.low_places[i, 0]:.3f} {shares.low_places[i, 1]:.3f}"
        )
    bound = np.sqrt(np.mean([s.gage_bound**2 for s in sessions], axis=0))[INNER, 1]
    lines.append(f"gages covered {shares.gages:.3f}, bending bound at most {bound.max():.3f} ue")
    return "\n".join(lines)


if __name__ == "__main__":
    case, count = sys.argv[1], int(sys.argv[2])
    first = int(sys.argv[3]) if len(sys.argv) > 3 else 0
    print(told(case, [session((CASES | IN_PHASE)[case], first + seed) for seed in range(count)]))
