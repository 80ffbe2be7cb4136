"""An instrument at one view, seen as a camera: scan lines in, complex pixels out.

`ViewContext` has what is at hand while a session is in one view, also the `Operator`: the person
at the terminal, who is asked when something must be done by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose
from sldvexp.instrument import Acquisition, Instrument, RawSamples, Status
from sldvexp.laser import TwoMirror
from sldvexp.scan import Sampling
from sldvexp.session.journal import Journal
from sldvexp.signal import ComplexImage, Flag, SignalEstimator
from sldvexp.stopping import undisturbed
from sldvexp.targets import Target
from sldvexp.typing import IntArray


class NobodyThereError(UserError):
    """Something must be done by hand, but there is nobody to ask."""


class Operator:
    """Asks at the terminal.

    Parameters
    ----------
    screen : callable, optional
        Makes a context in which nothing else is drawn there.
    """

    def __init__(self, screen: Callable[[], AbstractContextManager[object]] = nullcontext) -> None:
        self._screen = screen

    def ask(self, request: str) -> str:
        """Show a request and wait for a line, which is returned without spaces around it.

        Raises
        ------
        NobodyThereError
            If the input has ended.
        """
        with self._screen():
            try:
                return input(request).strip()
            except EOFError:
                what = request.strip().splitlines()[-1].rstrip(":")
                raise NobodyThereError(f"nobody is at the terminal to answer {what!r}") from None


class Camera:
    """Takes complex images line by line, from the journal where it has the line already.

    A context manager: leaving it leaves the instrument, which goes home.

    Parameters
    ----------
    arrive : callable
        Opens the instrument in this view. Called when it is needed for the first time; a view
        that is in the journal as a whole needs none.
    signal : SignalEstimator
    journal : Journal
        Of this view.
    """

    def __init__(
        self,
        arrive: Callable[[], AbstractContextManager[Instrument]],
        signal: SignalEstimator,
        journal: Journal,
    ) -> None:
        self.signal = signal
        self.journal = journal
        self._arrive = arrive
        self._opened = ExitStack()
        self._instrument: Instrument | None = None
        self._wanted: Acquisition | None = None
        self._set: Acquisition | None = None
        self._taken = 0

    def __enter__(self) -> Camera:
        return self

    def __exit__(self, *exception: object) -> None:
        with undisturbed():
            self._opened.__exit__(*exception)  # type: ignore[arg-type]

    @property
    def instrument(self) -> Instrument:
        """Instrument, sampling as was said last."""
        if self._instrument is None:
            self._instrument = self._opened.enter_context(self._arrive())
        if self._wanted is not None and self._set != self._wanted:
            self._instrument.configure(self._wanted)
            self._set = self._wanted
        return self._instrument

    def sample(self, sampling: Sampling) -> None:
        """Say how all pixels that follow are sampled."""
        s = sampling
        self._wanted = Acquisition(s.rate, s.samples, tuple(s.frequency), s.amplitude)

    def image(self, name: str, lines: Sequence[IntArray]) -> ComplexImage:
        """Scan some lines and turn them into complex pixels.

        Parameters
        ----------
        name : str
            Of these lines, unique in the view.
        lines : sequence of ndarray of int, shape (pixel, 2)

        Returns
        -------
        ComplexImage
            Of the pixels of all lines, in their order.
        """
        assert self._wanted is not None, "call sample first"
        samples = [self._line(f"{name}_{k:03d}", dac) for k, dac in enumerate(lines)]
        times = np.arange(self._wanted.samples) / samples[0].rate
        status = np.concatenate([s.status for s in samples])
        image = self.signal.demodulate(
            np.concatenate([s.counts for s in samples]),
            times,
            self._wanted.excitation,
            volts_per_count=samples[0].volts_per_count,
            quality=status & Status.dropped_out == 0,
        )
        over = np.where(status & Status.over_range, Flag.saturated, 0).astype(np.uint8)
        return replace(image, flags=image.flags | over)

    def _line(self, name: str, dac: IntArray) -> RawSamples:
        """Scan one line; its number in the view makes a repeated one the same on a virtual lab."""
        number, self._taken = self._taken, self._taken + 1
        assert self._wanted is not None
        return self.journal.line(
            name, dac, self._wanted, lambda: self.instrument.scan(dac, stream=number)
        )


@dataclass(frozen=True)
class ViewContext:
    """One view, from the first pixel to the last.

    Attributes
    ----------
    view : str
    camera : Camera
        Its `instrument` is opened when something asks for it.
    laser : TwoMirror
    target : Target or None
    operator : Operator
    poses : dict of str to KnownPose
        The view's rough pose once its circles have corrected it, for what is scanned after them.
    """

    view: str
    camera: Camera
    laser: TwoMirror
    target: Target | None
    operator: Operator
    poses: dict[str, KnownPose] = field(default_factory=dict)
