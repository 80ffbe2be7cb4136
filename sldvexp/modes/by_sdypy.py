"""`modal=sdypy`: poles of the package sdypy-EMA, to hold others against.

Its fit weighs all pixels alike and tells no uncertainty, and asks near which frequencies to look:
it is given those of `modal=own`. Noise biases its damping towards zero.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.modes.base import ModalFit, ModalMethod
from sldvexp.modes.compression import compress
from sldvexp.modes.harmonics import weigh
from sldvexp.modes.likelihood import at_poles
from sldvexp.modes.model import poles_of
from sldvexp.modes.own import MostLikelyModes
from sldvexp.modes.responses import Responses

#: How far lines may be from multiples of their spacing, in spacings.
UNEVEN = 1e-3
#: Orders that the package's fit needs, at the least, to tell what is stable.
FEWEST_ORDERS = 4


@register("modal", "sdypy")
@dataclass
class SdypyModes(ModalMethod):
    """Least-squares complex frequency fits of all pixels by sdypy-EMA.

    Needs the extra: ``pip install 'sldvexp[modal]'``.

    Parameters
    ----------
    band : list of 2 float, Hz
        Lines that are used; all without it. They must be multiples of one spacing.
    order : int
        Highest order of its polynomials.
    """

    band: list[float] = field(default_factory=list)
    order: int = 40

    def __post_init__(self) -> None:
        MostLikelyModes(band=self.band)  # which says what is wrong with a band
        checks = Checks()
        needed = "needs the package sdypy-EMA: pip install 'sldvexp[modal]', or modal=own"
        checks.require(find_spec("sdypy") is not None, "", needed)
        ok = self.order >= FEWEST_ORDERS
        checks.require(ok, "order", f"must be at least {FEWEST_ORDERS}, not {self.order}")
        checks.done()

    @property
    def lines(self) -> tuple[float, float] | None:
        """See `ModalMethod`."""
        return MostLikelyModes(band=self.band).lines

    @property
    def left_out(self) -> Sequence[float]:
        """See `ModalMethod`; its lines must be evenly spaced."""
        return ()

    def identify(self, responses: Responses) -> ModalFit:
        """See `ModalMethod`; the covariance is NaN."""
        from sdypy import EMA

        line = responses.frequency
        spacing = (line[-1] - line[0]) / (len(line) - 1)
        if np.abs(line / spacing - np.rint(line / spacing)).max() > UNEVEN:
            raise UserError("modal=sdypy needs lines at multiples of one spacing; choose modal=own")
        own = MostLikelyModes(band=self.band).identify(responses)
        near = np.abs(own.pole) / (2 * np.pi)
        seen = np.concatenate([view.velocity for view in responses.views()])
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            model = EMA.Model(
                frf=seen,
                freq=line,
                lower=line[0] - spacing / 2,
                upper=line[-1] + spacing,  # the last line is not used otherwise
                pol_order_high=self.order,
                frf_form="mobility",
            )
            model.get_poles(method="lscf", show_progress=False)
            model.select_closest_poles(list(near))
        natural, damping = np.array(model.nat_freq), np.array(model.nat_xi)
        found = (natural > line[0]) & (natural < line[-1]) & (damping > 0) & (damping < 1)
        if not found.any():
            raise UserError("sdypy-EMA finds no stable pole; choose modal.order higher")
        poles = poles_of(2 * np.pi * natural[found], damping[found])
        principal = weigh(compress(responses), responses, own.harmonics)
        fit = at_poles(principal, poles)
        fit = replace(fit, start=np.flatnonzero(found)[fit.start])
        return ModalFit.from_poles(fit, principal, own.harmonics, own.stabilisation)
