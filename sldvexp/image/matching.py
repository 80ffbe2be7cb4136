"""Which ellipse of the image is which circle of the calibration object.

Whatever the instrument's roll, a mirror image or the order in which the circles were scanned, the
right assignment is the one for which a projective map takes the circles' bitangent points to those
of the ellipses. The two-mirror scanner is not quite projective (tan and the mirror offset bend the
image), so that up to a few steps remain; a wrong assignment leaves tens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry import BitangentPoints, Ellipse, bitangents
from sldvexp.geometry.bitangent import MIRRORED
from sldvexp.image.assignment import Assignment, assignments, circles_by_plane
from sldvexp.targets import Circles

#: Residual, in steps, that the projective approximation may leave, and the factor by which the
#: second best assignment must be worse than the best.
APPROXIMATION, DISTINCT = 0.3, 2.0
#: Obliqueness that the approximation may leave of a scanner's image.
STRAIGHT = 0.15
#: Residual, as a fraction of the smallest semi-axis, above which the image is of something else.
ALIEN = 0.2


@dataclass(frozen=True)
class Match:
    """Assignment of the image's ellipses to the object's circles.

    Parameters
    ----------
    ellipse : dict of int to int
        Index of the ellipse of each circle, by the circle's number.
    mirrored : bool
        Whether the image turns the other way than the object does for a viewer on the side that its
        normal points to. The second image coordinate counts as left of the first, as it is with
        (up_down, left_right) seen from the instrument. True means a mirror that is swapped with the
        other or wired the other way round, or an object whose normal points away.
    residual : float, steps
        Root mean square of what the projective map leaves at the bitangent points.
    runner_up : float, steps
        The same for the second best assignment; infinite if there is no other.
    """

    ellipse: dict[int, int]
    mirrored: bool
    residual: float
    runner_up: float


def match_circles(
    target: Circles, ellipses: Sequence[Ellipse], mirrored: bool | None = None
) -> Match:
    """Find the circle that each ellipse is the image of.

    Circles on several planes are matched plane by plane and then together, by one camera matrix for
    all. A circle that is alone on its plane has no bitangents; one such circle takes the ellipse
    that is left over.

    Parameters
    ----------
    ellipses : sequence of Ellipse
        One for each circle, in any order.
    mirrored : bool, optional
        Consider only images that are mirrored, or only those that are not. Two circles alone look
        the same mirrored, so that they need it.

    Raises
    ------
    UserError
        If the numbers differ, no assignment fits, or two fit nearly equally well; it then says how
        the two differ and what would tell them apart.
    """
    if len(ellipses) != len(target.circles):
        raise UserError(
            f"the calibration object has {len(target.circles)} circles, but {len(ellipses)} "
            f"ellipses were found in the image; every circle must be scanned once"
        )
    lone = [members[0] for members in circles_by_plane(target) if len(members) == 1]
    if len(lone) > 1:
        raise UserError(
            f"circles {', '.join(map(str, lone))} are each alone on their plane, where they have "
            f"no bitangents to be matched by; put a second circle on all but one of these planes"
        )
    found = assignments(target, ellipses, [False, True] if mirrored is None else [mirrored])
    found = _straight(_upright(found))
    _check(found, ellipses)
    best = found[0]
    left = set(range(len(ellipses))) - set(best.ellipse.values())
    whole = best.ellipse | dict(zip(lone, left, strict=True))
    runner_up = found[1].residual if len(found) > 1 else np.inf
    return Match(dict(sorted(whole.items())), best.mirrored, best.residual, runner_up)


def bitangent_images(
    ellipses: Sequence[Ellipse], match: Match, pairs: Sequence[tuple[int, int]]
) -> BitangentPoints:
    """Find image points of the object's bitangent points.

    Parameters
    ----------
    ellipses : sequence of Ellipse
        As given to `match_circles`.
    pairs : sequence of (int, int)
        Ordered pairs of circles by their numbers, such as those of ``Circles.selected_pairs``.

    Returns
    -------
    BitangentPoints
        Pairs as given, lines as they are on the object: in a mirror image the line that is left on
        the object is right in the image.

    Raises
    ------
    UserError
        If the ellipses of a pair overlap.
    """
    numbers = list(match.ellipse)
    ordered = [ellipses[match.ellipse[n]] for n in numbers]
    index = [(numbers.index(a), numbers.index(b)) for a, b in pairs]
    found = bitangents(ordered, index, [f"circle {n}" for n in numbers])
    if not match.mirrored:
        return found
    covariance = found.covariance[:, MIRRORED][:, :, :, :, :, MIRRORED]
    return BitangentPoints(found.points[:, MIRRORED], covariance)


def _upright(found: list[Assignment]) -> list[Assignment]:
    """Leave out assignments that rival an upright one but see space inside out."""
    near = [a for a in found if not _worse(a, found[0])]
    if not any(a.upright for a in near):
        return found
    return [a for a in found if a.upright or a not in near]


def _straight(found: list[Assignment]) -> list[Assignment]:
    """Leave out assignments that rival that of a scanner, but of which none could take the image.

    Two equal circles on each of two planes look the same when each pair changes places: to a camera
    whose image is oblique to its line of sight.
    """
    near = [a for a in found if not _worse(a, found[0])]
    least = min((a.obliqueness for a in near), default=np.inf)
    if least > STRAIGHT:
        return found
    most = max(STRAIGHT, DISTINCT * least)
    return [a for a in found if a.obliqueness <= most or a not in near]


def _worse(other: Assignment, best: Assignment) -> bool:
    return other.residual >= DISTINCT * max(best.residual, APPROXIMATION)


def _check(found: list[Assignment], ellipses: Sequence[Ellipse]) -> None:
    """Refuse an image of something else, and a second assignment nearly as good as the first."""
    size = min(float(e.semi_axes[1]) for e in ellipses)
    if not found or found[0].residual > ALIEN * size:
        left = f"{found[0].residual:.3g} steps rms" if found else "points behind the image"
        raise UserError(
            f"the ellipses of the image are not those of the calibration object: the best "
            f"assignment leaves {left} at the bitangent points, more than {100 * ALIEN:.0f} % of "
            f"the smallest semi-axis ({size:.3g} steps); compare the target with the real object"
        )
    if len(found) < 2:
        return
    best, second = found[:2]
    if not _worse(second, best):
        ratio = second.residual / max(best.residual, np.finfo(float).tiny)
        moved = [n for n in sorted(best.ellipse) if best.ellipse[n] != second.ellipse[n]]
        how = [f"circles {', '.join(map(str, moved))} change places"] if moved else []
        how += ["the image is mirrored"] if best.mirrored != second.mirrored else []
        raise UserError(
            f"the calibration object looks the same in two ways: the ellipses fit its circles to "
            f"{best.residual:.3g} steps rms, and to {second.residual:.3g} if {' and '.join(how)} "
            f"(a ratio of {ratio:.3g}, where {DISTINCT:g} times as much and "
            f"{DISTINCT * APPROXIMATION:g} steps are needed); a circle of another diameter, or one "
            f"moved off the symmetric place, would tell the two apart"
        )
