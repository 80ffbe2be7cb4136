"""`modal=own`: most likely poles of all pixels at once, found without clicks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.modes.base import ModalFit, ModalMethod
from sldvexp.modes.compression import PrincipalResponses, compress
from sldvexp.modes.harmonics import find_harmonics, weigh
from sldvexp.modes.likelihood import most_likely
from sldvexp.modes.lscf import poles_by_order
from sldvexp.modes.responses import Responses
from sldvexp.modes.stabilisation import StabilityRules, stabilise

#: Orders for each principal response, and at least, where no order is chosen.
ORDERS_EACH, ORDERS = 8, 40
#: Lines that the smallest fit needs, and those that each signal needs for its pole.
FEWEST_LINES, LINES_EACH = 8, 4


@register("modal", "own")
@dataclass
class MostLikelyModes(ModalMethod):
    """Starts of linear fits of all orders, then the most likely poles of all pixels.

    Parameters
    ----------
    band : list of 2 float, Hz
        Lines that are used; all without it.
    leave_out : list of float, Hz
        Lines that are not used, as harmonics of strong ones.
    order : int
        Highest order of the linear fits; 0 takes as many as the number of signals asks for.
    frequency, damping : float
        Largest relative change of a stable pole from one order to the next.
    mac : float
        Smallest modal assurance criterion of its two shapes.
    highest_damping : float
        Largest damping ratio of a mode.
    share : float
        Smallest share of the orders that a mode is stable in.
    """

    band: list[float] = field(default_factory=list)
    leave_out: list[float] = field(default_factory=list)
    order: int = 0
    frequency: float = 0.01
    damping: float = 0.1
    mac: float = 0.95
    highest_damping: float = 0.1
    share: float = 0.4

    def __post_init__(self) -> None:
        checks = Checks()
        ok = not self.band or (len(self.band) == 2 and 0 <= self.band[0] < self.band[1])
        checks.require(ok, "band", f"must be two rising frequencies in Hz, not {self.band}")
        ok = self.order == 0 or self.order >= 4
        checks.require(ok, "order", f"must be 0 or at least 4, not {self.order}")
        for hertz in self.leave_out:
            checks.positive("leave_out", hertz)
        checks.positive("frequency", self.frequency)
        checks.positive("damping", self.damping)
        for name in ("mac", "highest_damping", "share"):
            checks.probability(name, getattr(self, name))
        checks.done()

    @property
    def lines(self) -> tuple[float, float] | None:
        """See `ModalMethod`."""
        return (self.band[0], self.band[1]) if self.band else None

    @property
    def left_out(self) -> Sequence[float]:
        """See `ModalMethod`."""
        return self.leave_out

    def identify(self, responses: Responses) -> ModalFit:
        """See `ModalMethod`."""
        lines = len(responses.frequency)
        if lines < FEWEST_LINES:
            raise UserError(
                f"{lines} lines are too few to find modes; measure at least {FEWEST_LINES}, and "
                "several across every resonance"
            )
        principal = compress(responses)
        if not len(principal.values):
            raise UserError(
                f"nothing stands out of the noise between {responses.frequency[0]:g} and "
                f"{responses.frequency[-1]:g} Hz: there is no mode to find"
            )
        poles = poles_by_order(principal, self._highest_order(principal))
        found = stabilise(poles, principal, self.rules)
        band = f"between {responses.frequency[0]:g} and {responses.frequency[-1]:g} Hz"
        if not found.modes:
            signals = len(principal.values)
            wanted = LINES_EACH * signals
            few = (
                f"; {signals} signals stand out of the noise, for whose poles {lines} lines are "
                f"too few: measure at least {wanted}, several across every resonance"
            )
            told = f"no mode lies {band}: no pole stays as the order grows"
            raise UserError(told + (few if lines < wanted else ""))
        fit = most_likely(principal, found.starts())
        harmonics = find_harmonics(responses, principal, fit.by_line)
        if len(harmonics.order) and len(fit.pole):
            principal = weigh(principal, responses, harmonics)
            again = most_likely(principal, fit.pole)
            fit = replace(again, start=fit.start[again.start])
        if not len(fit.pole):
            raise UserError(f"no mode lies {band}: those that are seen lie beside it")
        return ModalFit.from_poles(fit, principal, harmonics, found)

    @property
    def rules(self) -> StabilityRules:
        """What makes a pole stable, and a mode."""
        return StabilityRules(
            self.frequency, self.damping, self.mac, self.highest_damping, self.share
        )

    def _highest_order(self, principal: PrincipalResponses) -> int:
        """Choose the highest order that is fitted; half the lines are left for the noise."""
        wanted = self.order or max(ORDERS, ORDERS_EACH * len(principal.values))
        return min(wanted, len(principal.frequency) // 2)
