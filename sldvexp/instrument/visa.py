"""`instrument=visa`: an instrument that is spoken to as a profile says.

The profile, a file of ``conf/profile/``, has the commands of each step and what is answered;
`CommandedInstrument` goes through them and is the `Instrument` that the session knows.
"""

from __future__ import annotations

import importlib.util
import logging
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from omegaconf import MISSING

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError, nearest
from sldvexp.instrument.blocks import better_reading, block_size, decoded
from sldvexp.instrument.connection import DisturbanceError, Line, VisaLine, canonical_resource
from sldvexp.instrument.dialogue import Counted, Dialogue, Persistence
from sldvexp.instrument.playing import in_words, played_by, records_of, require_playable
from sldvexp.instrument.profile import Profile
from sldvexp.instrument.profile_file import load_profile, profile_path
from sldvexp.instrument.protocol import (
    CHANNELS,
    Acquisition,
    Instrument,
    InstrumentError,
    RawSamples,
    ScanningPlugin,
    Status,
)
from sldvexp.laser import TwoMirror
from sldvexp.targets import Target
from sldvexp.typing import IntArray

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
        for name in names:
            try:
                canonical_resource(name)
            except ValueError as error:
                checks.require(False, "resource", f"{name} {error}")
        checks.done()
        self._warn = Counted()  # over all connections
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

    @property
    def source(self) -> dict[str, str]:
        """See `ScanningPlugin`; an address may change from one day to the next."""
        return {"profile": self.profile}

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
        how = (self.timeout, self.retries, view, self._warn)
        return CommandedInstrument(self._spoken, self._line, *how)

    def _line(self, device: str) -> Line:
        named = self.resource[device] if isinstance(self.resource, dict) else self.resource
        return VisaLine(canonical_resource(named), self.backend, self.timeout)


log = logging.getLogger(__name__)
#: What is said of an instrument that could not be left as it should be.
NOT_HOME = "the mirrors may not be home and the generator may be on"
#: How far a rate may be from a whole number of microseconds between samples, relative.
WHOLE = 1e-9
#: All bits that a record's status may have.
KNOWN = np.uint8(Status.dropped_out | Status.over_range | Status.untriggered)


class CommandedInstrument:
    """A scanning vibrometer that speaks as a profile says.

    After a time-out, a lost connection or garbage, the connection is made again, the instrument
    is brought back to where it was, and the interrupted step is repeated as a whole.

    Parameters
    ----------
    profile : Profile
    connect : callable
        Opens the line to the device of that name.
    timeout : float, s
        How long an answer may take, besides the time that sampling takes.
    retries : int
        How often a step is repeated.
    view : str
        Where to stand, if the profile can go there; empty stays.
    warn : Counted, optional
        Warns of disturbances; connections that follow one another share it.
    """

    def __init__(
        self,
        profile: Profile,
        connect: Callable[[str], Line],
        timeout: float,
        retries: int,
        view: str = "",
        warn: Counted | None = None,
    ) -> None:
        self.profile = profile
        self._view = view
        self._persistently = Persistence(
            lambda: Dialogue(profile, connect, timeout), self._restore, retries, warn or Counted()
        )
        self._acquisition: Acquisition | None = None
        self._position: tuple[int, int] | None = None
        self._rate = 0.0
        self._scale: list[float] = []
        self._read_rightly = False
        self._told: Acquisition | None = None  # what the device took last

    def __enter__(self) -> CommandedInstrument:
        self._persistently("connecting", lambda dialogue: None)
        return self

    def __exit__(self, *exception: object) -> None:
        error = exception[1]
        # Nothing that might be refused on the way: going home must not depend on it.
        self._acquisition, self._position, self._view = None, None, ""
        try:
            self._persistently("going home", self._go_home)
        except InstrumentError as left:
            what = f"{NOT_HOME}: {left}"
            if error is None:
                raise InstrumentError("", what) from left
            if isinstance(error, InstrumentError):
                raise InstrumentError(error.why, what) from error
            log.error(what)
        finally:
            self._persistently.hang_up()

    def configure(self, acquisition: Acquisition) -> None:
        """Set sampling and generator for all pixels that follow."""
        numbers = (acquisition.rate, acquisition.amplitude, *acquisition.excitation)
        if not (np.isfinite(numbers).all() and acquisition.rate > 0 and acquisition.samples > 0):
            raise InstrumentError(
                f"configuring: rate and samples must be positive numbers, not {acquisition}"
            )
        before, self._told, self._acquisition = self._told, None, acquisition
        alike = before is not None and replace(before, records=acquisition.records) == acquisition
        if alike and acquisition.drive is not None:  # what is played goes on
            self._persistently("configuring", self._count_records)
            self._told = acquisition
            return
        if acquisition.plays and not self.profile.commands.generator_on:
            played = in_words(acquisition)
            log.warning("the generator is set by hand: %s with %g V", played, acquisition.amplitude)
        elif acquisition.drive is not None:
            require_playable(self.profile, acquisition.drive.excitation.kind)
        self._persistently("configuring", self._configure)
        self._told = acquisition

    def move(self, dac: Sequence[int]) -> None:
        """Point the beam at (up_down, left_right) in DAC steps."""
        self._position = (int(dac[0]), int(dac[1]))
        self._persistently("moving", self._move)

    def acquire(self) -> RawSamples:
        """Sample one pixel where the beam stands."""
        return self._persistently("sampling", self._acquire)

    def scan(self, dac: IntArray, stream: int | None = None) -> RawSamples:
        """Move to and sample a list of pixels.

        Parameters
        ----------
        dac : ndarray of int, shape (pixel, 2)
        stream : int, optional
            Number of the scan line, for an instrument that is a simulation.

        Raises
        ------
        InstrumentError
            If the instrument refuses, or is disturbed more often than steps are repeated.
        """
        steps = [(int(up_down), int(left_right)) for up_down, left_right in dac]
        if not steps:
            return self._samples(b"", b"", 0)
        listed = bool(self.profile.commands.scan) and self._at_once == self._records
        found = self._persistently(
            f"scanning {len(steps)} pixels",
            lambda dialogue: (self._scan_list if listed else self._scan_pixels)(
                dialogue, steps, stream
            ),
        )
        self._position = steps[-1]
        return found

    def read_position(self) -> tuple[int, int] | None:
        """See `TellsAtBench`."""
        bench = self.profile.bench
        if bench is None or not bench.position:
            return None
        found = self._persistently(
            "reading the mirrors back",
            lambda dialogue: dialogue.numbers("bench.position", bench.device, bench.position, 2),
        )
        return round(found[0]), round(found[1])

    def light_level(self) -> float | None:
        """See `TellsAtBench`."""
        bench = self.profile.bench
        if bench is None or not bench.light:
            return None
        (found,) = self._persistently(
            "reading the light",
            lambda dialogue: dialogue.numbers("bench.light", bench.device, bench.light, 1),
        )
        return min(max(found, 0.0), 1.0)

    def picture(self) -> NDArray[np.uint8] | None:
        """See `TellsAtBench`."""
        bench = self.profile.bench
        if bench is None or not bench.picture:
            return None
        rows, columns = bench.picture_size
        block = self._persistently(
            "taking a picture",
            lambda dialogue: dialogue.block(bench.picture, rows * columns, key="bench.picture"),
        )
        return np.frombuffer(block, np.uint8).reshape(rows, columns)

    def _restore(self, dialogue: Dialogue) -> None:
        """Bring the instrument to where the program believes it is."""
        commands = self.profile.commands
        dialogue.run(commands.setup)
        if self._view:
            self._go_to_view(dialogue)
        if self._acquisition is not None:
            self._configure(dialogue)
        if self._position is not None:
            self._move(dialogue)

    def _go_to_view(self, dialogue: Dialogue) -> None:
        """Go to the view, whose name the configuration and the instrument must share."""
        try:
            dialogue.run(self.profile.commands.view, {"view": self._view})
        except DisturbanceError:
            raise
        except InstrumentError as error:
            raise InstrumentError(
                f"{error}; scan.views calls a view {self._view}: call it as the instrument does"
            ) from error

    def _configure(self, dialogue: Dialogue) -> None:
        """Send the acquisition, and keep the rate (Hz) and scales that the device answers."""
        a, data, commands = self._configured(), self.profile.data, self.profile.commands
        values = {
            "rate": a.rate,
            "interval": 1.0 / a.rate,
            "interval_us": self._microseconds(a.rate),
            "samples": a.samples,
            "frequencies": ",".join(map(str, a.excitation)),
            "amplitude": a.amplitude,
        }
        dialogue.run(commands.configure, values)
        self._count_records(dialogue)  # also one: the device may have those of a run before
        if a.drive is not None:
            dialogue.run(commands.play, played_by(self.profile, a.drive))
        else:
            dialogue.run(commands.generator_on if a.excitation else commands.generator_off, values)
        self._rate = a.rate
        if data.rate:
            (self._rate,) = dialogue.numbers("data.rate", data.device, data.rate, 1)
        in_block = [data.volts_per_count.get(channel, 0.0) for channel in data.channels]
        if data.scale:
            in_block = dialogue.numbers("data.scale", data.device, data.scale, len(CHANNELS))
        self._scale = [in_block[data.channels.index(channel)] for channel in CHANNELS]
        dialogue.verify(playing=a.plays)
        self._read_rightly = False

    def _count_records(self, dialogue: Dialogue) -> None:
        """Say how many records a pixel takes, if the device can be told."""
        dialogue.run(self.profile.commands.records, records_of(self._configured()))

    def _microseconds(self, rate: float) -> int:
        """Count whole microseconds between samples, for a device that counts them."""
        exact = 1e6 / rate
        whole = max(1, round(exact))
        texts = [t for ts in self.profile.commands.configure.values() for t in ts]
        if abs(whole - exact) > WHOLE * exact and any("{interval_us" in t for t in texts):
            raise InstrumentError(
                f"{rate:.10g} samples a second are not a whole number of microseconds apart, as "
                f"this instrument needs; the nearest rate that is so is {1e6 / whole:.10g}"
            )
        return whole

    def _move(self, dialogue: Dialogue) -> None:
        assert self._position is not None
        up_down, left_right = self._position
        dialogue.run(self.profile.commands.move, {"up_down": up_down, "left_right": left_right})

    @property
    def _records(self) -> int:
        return self._configured().records

    @property
    def _at_once(self) -> int:
        """Records that one command takes."""
        return self._records if self.profile.commands.records else 1

    def _acquire(self, dialogue: Dialogue) -> RawSamples:
        a = self._configured()
        alone = self._at_once < a.records  # then the lead is waited for here
        time.sleep(self.profile.settle + alone * a.lead * a.samples / a.rate)
        found = []
        for _ in range(a.records // self._at_once):
            patience = self._duration(1)
            dialogue.run(self.profile.commands.acquire, {"samples": a.samples}, patience)
            found.append(self._fetch(dialogue, 1))
        return self._joined(found)

    def _joined(self, found: list[RawSamples]) -> RawSamples:
        counts = np.concatenate([s.counts for s in found])
        status = np.concatenate([s.status for s in found])
        return RawSamples(counts, found[0].volts_per_count, self._rate, status, self._records)

    def _scan_list(
        self, dialogue: Dialogue, steps: list[tuple[int, int]], stream: int | None
    ) -> RawSamples:
        """Scan a list that the instrument goes through by itself."""
        commands, samples = self.profile.commands, self._configured().samples
        if stream is not None:
            dialogue.run(commands.stream, {"stream": stream})
        positions = ",".join(f"{up_down},{left_right}" for up_down, left_right in steps)
        values = {"positions": positions, "pixels": len(steps), "samples": samples}
        dialogue.run(commands.scan, values, self._duration(len(steps)))
        found = self._fetch(dialogue, len(steps))
        dialogue.verify(playing=self._configured().plays)
        return found

    def _scan_pixels(
        self, dialogue: Dialogue, steps: list[tuple[int, int]], stream: int | None
    ) -> RawSamples:
        """Scan a list that the program goes through."""
        if stream is not None:
            dialogue.run(self.profile.commands.stream, {"stream": stream})
        found = []
        for self._position in steps:
            self._move(dialogue)
            found.append(self._acquire(dialogue))
        dialogue.verify(playing=self._configured().plays)
        return self._joined(found)

    def _fetch(self, dialogue: Dialogue, pixels: int) -> RawSamples:
        """Fetch the samples of the last pixels."""
        data, patience = self.profile.data, self._duration(pixels)
        rows = pixels * self._at_once
        size = block_size(data, rows, self._configured().samples)
        block = dialogue.block(data.ask, size, patience)
        status = dialogue.block(data.status, rows, key="data.status") if data.status else b""
        dialogue.require_no_error(data.device, data.ask or "sending its samples")
        if not self._read_rightly:
            self._require_right_reading(block, rows)
        return self._samples(block, status, rows)

    def _require_right_reading(self, block: bytes, rows: int) -> None:
        """Require, once an acquisition, that the reference is what the generator plays."""
        data, a = self.profile.data, self._configured()
        better = better_reading(data, block, (rows, a.samples), a.excitation, self._rate)
        if better:
            raise InstrumentError(
                f"the reference channel is no sum of the generator's sines as the profile reads "
                f"{data.device}'s samples, and is one with {better}"
            )
        self._read_rightly = True

    def _samples(self, block: bytes, status: bytes, rows: int) -> RawSamples:
        shape = (rows, self._configured().samples)
        found = decoded(self.profile.data, block, status, shape, self._scale, self._rate)
        nonsense = np.flatnonzero(found.status & ~KNOWN)
        if len(nonsense):
            pixel, record = divmod(int(nonsense[0]), self._at_once)
            which = f"record {record} of pixel {pixel}" if self._at_once > 1 else f"pixel {pixel}"
            raise DisturbanceError(
                f"the status of {which} is nonsense: {found.status[nonsense[0]]} in "
                f"answer to {self.profile.data.status} (data.status of the profile)"
            )
        return replace(found, records=self._at_once)

    def _duration(self, pixels: int) -> float:
        """Say how long sampling takes, s."""
        return pixels * (self._configured().seconds + self.profile.settle)

    def _configured(self) -> Acquisition:
        if self._acquisition is None:
            raise InstrumentError("the instrument was not configured; call configure first")
        return self._acquisition

    def _go_home(self, dialogue: Dialogue) -> None:
        """Switch the generator off and send the mirrors home, each also if the other is refused."""
        refused: list[str] = []
        for commands in (self.profile.commands.generator_off, self.profile.commands.home):
            try:
                dialogue.run(commands)
            except DisturbanceError:
                raise
            except InstrumentError as error:
                refused.append(str(error))
        if refused:
            raise InstrumentError("; ".join(refused))
