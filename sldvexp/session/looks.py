"""What the coarse lines show at each rough centre, and what is wrong where they show no circle."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry.conic import Ellipse
from sldvexp.signal.complex_image import ComplexImage
from sldvexp.signal.instrument_faults import MOST, instrument_fault, moving

#: Share of the pixels that must move where something moves.
SOME = 0.02
#: Share of flagged pixels that explains why a circle that moves is not found.
MANY = 0.2
#: Share of pixels that move on lines which lie inside a circle.
NEARLY_ALL = 0.9
#: Velocities are told in mm/s.
MILLI = 1e3


@dataclass(frozen=True, eq=False)
class Look:
    """Coarse lines through one rough centre.

    Parameters
    ----------
    name : str
        As in "the circle around DAC steps (10, 20)".
    files : str
        Pattern of its scan lines' files.
    image : ComplexImage
    ellipse : Ellipse or None
    problem : str
        Why there is none.
    """

    name: str
    files: str
    image: ComplexImage
    ellipse: Ellipse | None = None
    problem: str = ""

    @property
    def silent(self) -> bool:
        """Whether nothing moves there."""
        return self.ellipse is None and float(np.mean(moving(self.image))) < SOME


def require_circles(looks: Sequence[Look], folder: Path, suspicion: str = "") -> None:
    """Refuse to go on if a rough centre shows no circle, or two show the same.

    Parameters
    ----------
    looks : sequence of Look
        Of all rough centres of a view.
    folder : Path
        Where the view's scan lines are kept.
    suspicion : str
        Of the rough centres, told if nothing moves at any.

    Raises
    ------
    UserError
        That names the circle, the cause and what was seen.
    """
    for look in looks:
        if look.ellipse is None:
            require_instrument(look.image, look.name, folder)
    if silent := [look for look in looks if look.silent]:
        raise UserError(_nothing_moves(silent, len(looks), folder, suspicion))
    for look in looks:
        if look.ellipse is None:
            require_instrument(look.image, look.name, folder, MANY)
            raise UserError(_no_ellipse(look))
    found = [(look.name, look.ellipse) for look in looks if look.ellipse is not None]
    for (name, one), (other_name, other) in itertools.combinations(found, 2):
        if np.linalg.norm(one.centre - other.centre) < one.semi_axes[0]:
            raise UserError(
                f"{name} and {other_name} are one and the same, in fact around "
                f"({one.centre[0]:.0f}, {one.centre[1]:.0f}); give every circle one rough centre"
            )


def _no_ellipse(look: Look) -> str:
    """What may be wrong with lines that show a motion, but no circle."""
    longer = "give the lines more scan.coarse.pixels or a larger scan.coarse.stride"
    if np.mean(moving(look.image)) > NEARLY_ALL:
        return f"{look.name}: everything on its lines moves, they do not reach its edge; {longer}"
    return f"{look.problem}; put the rough centre nearer to the circle's middle, or {longer}"


def require_instrument(image: ComplexImage, name: str, files: Path, share: float = MOST) -> None:
    """Refuse pixels that say that something is wrong with the instrument.

    Parameters
    ----------
    image : ComplexImage
    name : str
        What they are of.
    files : Path
        Files, or the folder, that keep what was measured with that fault.
    share : float
        Of the pixels, from which a flag counts.

    Raises
    ------
    UserError
    """
    if fault := instrument_fault(image, share):
        raise UserError(f"{name}: {fault}; then delete {files} and resume the run")


def _nothing_moves(silent: Sequence[Look], count: int, folder: Path, suspicion: str) -> str:
    """What may be wrong with circles that do not move."""
    most = max(_largest(look.image) for look in silent)
    noise = max(float(np.median(look.image.std)) for look in silent)
    seen = f"{MILLI * most:.2g} mm/s at most, with a noise of {MILLI * noise:.2g}"
    if len(silent) == count:
        return (
            f"nothing moves at any of the {count} rough centres ({seen}): the calibration object "
            "is out of view, its speakers are not driven, or no light comes back; see that the "
            "speakers sound, and that the beam stands in each circle at its rough centre"
            f"{suspicion and '; '}{suspicion}"
        )
    names = " and ".join(look.name for look in silent)
    files = " and ".join(str(folder / look.files) for look in silent)
    what = "its speaker is" if len(silent) == 1 else "their speakers are"
    return (
        f"{names}: nothing moves there ({seen}), while {count - len(silent)} of {count} circles "
        f"move; {what} dead, or the rough centre lies beside the circle; once the speaker sounds, "
        f"delete {files} and resume the run"
    )


def _largest(image: ComplexImage) -> float:
    """Largest amplitude of a pixel that is not flagged, m/s; zero if all are."""
    return float(np.abs(image.velocity[image.flags == 0]).max(initial=0.0))
