"""`instrument=visa`: boards and instruments that PyVISA reaches, as a command profile says."""

from __future__ import annotations

import importlib.util
import logging
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from omegaconf import MISSING

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError, nearest
from sldvexp.instrument.command_instrument import CommandedInstrument
from sldvexp.instrument.connection import Line, VisaLine
from sldvexp.instrument.profile import Profile
from sldvexp.instrument.profile_file import load_profile, profile_path
from sldvexp.instrument.protocol import Instrument, ScanningPlugin
from sldvexp.laser import TwoMirror
from sldvexp.targets import Target

#: PyVISA's backends: in Python, and the VISA that a maker of interfaces has installed.
BACKENDS = ("@py", "@ivi")


@register("instrument", "visa")
@dataclass
class Visa(ScanningPlugin):
    """Whatever PyVISA reaches: sockets, GPIB, USB, serial lines.

    Parameters
    ----------
    resource : str or dict of str to str
        VISA's name of the device, or of each device of the profile,
        ``{dac: "GPIB0::9::INSTR", adc: "GPIB0::14::INSTR"}``.
    profile : str
        Name of a command profile that comes with the program, or the path of a YAML file.
    timeout : float, s
        How long an answer may take, besides the time that sampling takes.
    retries : int
        How often a step is repeated over a new connection after a time-out, a lost connection or
        garbage, before the run stops.
    backend : str
        ``@py`` or ``@ivi``, for the VISA library of a maker of interfaces.
    """

    resource: Any = MISSING
    profile: str = "virtual_lab"
    timeout: float = 2.0
    retries: int = 2
    backend: str = "@py"

    def __post_init__(self) -> None:
        checks = Checks()
        checks.positive("timeout", self.timeout)
        checks.require(self.retries >= 0, "retries", f"must be 0 or more, not {self.retries}")
        message = f"cannot be {self.backend}; {nearest(self.backend, BACKENDS)}"
        checks.require(self.backend in BACKENDS, "backend", message)
        names = self.resource.values() if isinstance(self.resource, dict) else [self.resource]
        given = bool(names) and all(isinstance(n, str) and n for n in names)
        message = "must be VISA's name of a device, or one for each as in {dac: ..., adc: ...}"
        checks.require(given, "resource", message)
        checks.done()
        self._spoken: Profile = load_profile(self.profile)
        devices = list(self._spoken.devices)
        named = list(self.resource) if isinstance(self.resource, dict) else devices[:1]
        message = f"must name {' and '.join(devices)}, the devices of the profile {self.profile}"
        checks.require(sorted(named) == sorted(devices), "resource", message)
        checks.done()

    @property
    def takes_views_itself(self) -> bool:
        """True if the profile has commands that go to a view."""
        return bool(self._spoken.commands.view)

    def inputs(self) -> list[str]:
        """List the profile's file."""
        return [str(profile_path(self.profile))]

    def open(
        self,
        scene: Any = None,
        laser: TwoMirror | None = None,
        target: Target | None = None,
        seed: int = 0,
        view: str = "",
    ) -> AbstractContextManager[Instrument]:
        """See `ScanningPlugin`; of the arguments only `view` matters.

        Raises
        ------
        UserError
            If PyVISA is not installed.
        """
        if importlib.util.find_spec("pyvisa") is None:
            raise UserError("instrument=visa needs the packages pyvisa and pyvisa-py")
        if not self._spoken.tried_on_hardware:
            logging.getLogger(__name__).warning(
                "nobody has tried the profile %s on hardware", self.profile
            )
        return CommandedInstrument(self._spoken, self._line, self.timeout, self.retries, view)

    def _line(self, device: str) -> Line:
        named = self.resource[device] if isinstance(self.resource, dict) else self.resource
        return VisaLine(named, self.backend, self.timeout)
