"""Sums over records of which response functions are made, a line and a pixel at a time.

With the phasors X of the reference and Y of the response of one record,
``Sxx = sum |X|^2``, ``Syy = sum |Y|^2`` and ``Sxy = sum conj(X) Y`` over the records that are good:
32 bytes a pixel and line, however many records there are. Records may come in any pieces, pixel by
pixel or record by record, and also after a session was cut off. Beside them stands per pixel how
many records were left out for which fault, and the noise beyond the band.

Of noise that goes on from record to record, stretches halfway between two records may be added.
They share half their samples with either, so that n records and m stretches are worth

    (n + m)^2 / (n + m + 4 m c)

independent ones, with the squared correlation c = 1/36 of Hann's window (Welch).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.errors import UserError
from sldvexp.signal.record_faults import RecordFault
from sldvexp.signal.sums_settings import SumsSettings
from sldvexp.typing import Array, BoolArray, ComplexArray, IntArray

#: Sums over records, of each pixel.
SUMS = ("sxx", "syy", "sxy", "count", "between", "left_out", "noise")
#: Squared correlation of noise in two stretches that overlap by half, both with Hann's window.
OVERLAPPED = 1 / 36


@dataclass(frozen=True, eq=False, repr=False)
class ResponseSums:
    """Streamed sums of some pixels; `add` changes them in place.

    Attributes
    ----------
    frequency : ndarray, shape (line,), Hz
    sxx : ndarray, shape (pixel, line), V2
        Of the reference's squared peak amplitudes.
    syy : ndarray, shape (pixel, line), (m/s)2
        Of the response's.
    sxy : ndarray of complex, shape (pixel, line), V m/s
        Of ``conj(X) Y``.
    count : ndarray of int, shape (pixel,)
        Good records.
    between : ndarray of int, shape (pixel,)
        Stretches halfway between two good records that are added besides.
    left_out : ndarray of int, shape (pixel, fault)
        Records with each `RecordFault`, by the first of those that a record has.
    noise : ndarray, shape (pixel,), (m/s)2
        Sum of the mean squares of the records' noise, as it is beyond the band.
    made : SumsSettings, optional
        What they are made with, if that is known.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.signal import ResponseSums
    >>> sums = ResponseSums.zeros(pixels=1, frequency=[50.0])
    >>> sums.add(reference=[[[1.0], [2.0]]], response=[[[1j], [2j]]])
    >>> sums.count.tolist(), (sums.sxy / sums.sxx).tolist()
    ([2], [[1j]])
    """

    frequency: Array
    sxx: Array
    syy: Array
    sxy: ComplexArray
    count: IntArray
    between: IntArray
    left_out: IntArray
    noise: Array
    made: SumsSettings | None = None

    def __repr__(self) -> str:
        pixels, lines = self.sxx.shape
        least, most = (self.count.min(), self.count.max()) if pixels else (0, 0)
        return f"sums of {least} to {most} records: {pixels} pixels, {lines} lines"

    @property
    def stretches(self) -> IntArray:
        """How many records and stretches between them are summed up, shape (pixel,)."""
        return np.asarray(self.count + self.between)

    @property
    def averages(self) -> Array:
        """How many independent records these are worth, shape (pixel,)."""
        whole = np.maximum(self.stretches, 1.0)
        worth = whole**2 / (whole + 4 * OVERLAPPED * self.between)
        return np.asarray(np.where(self.count > 0, worth, 0.0))

    @classmethod
    def zeros(
        cls, pixels: int, frequency: ArrayLike, made: SumsSettings | None = None
    ) -> ResponseSums:
        """Begin with no records of some pixels."""
        hertz = np.atleast_1d(np.asarray(frequency, float))
        shape = (pixels, len(hertz))
        return cls(
            hertz,
            np.zeros(shape),
            np.zeros(shape),
            np.zeros(shape, complex),
            np.zeros(pixels, np.int64),
            np.zeros(pixels, np.int64),
            np.zeros((pixels, len(RecordFault)), np.int64),
            np.zeros(pixels),
            made,
        )

    def add(
        self,
        reference: ArrayLike,
        response: ArrayLike,
        faults: ArrayLike | None = None,
        noise: ArrayLike | None = None,
        pixels: slice | None = None,
        between: bool = False,
    ) -> None:
        """Add records; those with a fault are only counted.

        Parameters
        ----------
        reference, response : array_like of complex, shape (pixel, record, line)
            Phasors X in V and Y in m/s, as `RecordDesign.spectra` gives them.
        faults : array_like of int, shape (pixel, record), optional
            Bits of `RecordFault`.
        noise : array_like, shape (pixel, record), (m/s)2, optional
            Mean squares of the records' noise.
        pixels : slice, optional
            Which pixels they are of; all without it.
        between : bool
            Whether they are stretches halfway between records, whose faults are counted already.
        """
        x, y = np.asarray(reference, complex), np.asarray(response, complex)
        where = pixels or slice(None)
        found = np.zeros(x.shape[:2], int) if faults is None else np.asarray(faults)
        if x.shape != y.shape or x.shape[::2] != self.sxx[where].shape:
            raise UserError(
                f"signal: records of the shapes {x.shape} and {y.shape} do not belong to "
                f"{len(self.sxx[where])} pixels and {len(self.frequency)} lines"
            )
        good = found == 0
        if not good.all():  # a spoilt record may be infinite, which times zero is not zero
            x, y = (np.where(good[..., None], z, 0) for z in (x, y))
        self.sxx[where] += (x.real**2 + x.imag**2).sum(axis=1)
        self.syy[where] += (y.real**2 + y.imag**2).sum(axis=1)
        self.sxy[where] += (np.conj(x) * y).sum(axis=1)
        if between:
            self.between[where] += good.sum(axis=1)
            return
        self.count[where] += good.sum(axis=1)
        first = found & -found.astype(np.int64)  # the lowest bit
        for k, fault in enumerate(RecordFault):
            self.left_out[where, k] += (first == fault).sum(axis=1)
        if noise is not None:
            self.noise[where] += np.where(good, noise, 0).sum(axis=1)

    def merged(self, other: ResponseSums) -> ResponseSums:
        """Join further records of the same pixels."""
        self._require_lines(other)
        if len(self.count) != len(other.count):
            raise UserError("signal: sums of different pixels cannot be added up")
        both = {name: getattr(self, name) + getattr(other, name) for name in SUMS}
        return ResponseSums(self.frequency, **both, made=self.made)

    @staticmethod
    def concatenated(parts: Sequence[ResponseSums]) -> ResponseSums:
        """Join pixels, as those of a view's scan lines, in their order."""
        for part in parts[1:]:
            parts[0]._require_lines(part)
        joined = {name: np.concatenate([getattr(p, name) for p in parts]) for name in SUMS}
        return ResponseSums(parts[0].frequency, **joined, made=parts[0].made)

    def at(self, lines: BoolArray) -> ResponseSums:
        """Keep some lines only; `lines` is True where one stays."""
        if lines.all():
            return self
        kept = {name: getattr(self, name)[:, lines] for name in ("sxx", "syy", "sxy")}
        return replace(self, frequency=self.frequency[lines], **kept)

    def of_pixels(self, pixels: BoolArray | slice) -> ResponseSums:
        """Keep some pixels only; `pixels` is True where one stays."""
        return replace(self, **{name: getattr(self, name)[pixels] for name in SUMS})

    def to_arrays(self) -> dict[str, NDArray]:
        """Give the arrays that a journal keeps; `from_arrays` makes the same sums of them."""
        made = {} if self.made is None else {"made": self.made.to_array()}
        return {name: getattr(self, name) for name in ("frequency", *SUMS)} | made

    def in_velocity_per_volt(self, factor: float) -> ResponseSums:
        """Make the sums that records would have with another factor of the velocity's volts.

        Which records are left out does not depend on it.

        Examples
        --------
        >>> sums = ResponseSums.zeros(1, [50.0], SumsSettings(0.01, 5.0, 0.1))
        >>> sums.add(reference=[[[1.0]]], response=[[[1j]]])
        >>> sums.in_velocity_per_volt(-0.02).sxy.tolist()
        [[(-0-2j)]]
        """
        if self.made is None or self.made.velocity_per_volt == factor:
            return self
        ratio = factor / self.made.velocity_per_volt
        return replace(
            self,
            syy=ratio**2 * self.syy,
            sxy=ratio * self.sxy,
            noise=ratio**2 * self.noise,
            made=replace(self.made, velocity_per_volt=factor),
        )

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray]) -> ResponseSums:
        """Make sums of what `to_arrays` gave; further arrays are not looked at."""
        none = {"between": np.zeros_like(arrays["count"])}  # of a journal that knows of none
        known = none | dict(arrays)
        made = SumsSettings.from_array(known["made"]) if "made" in known else None
        return cls(**{name: np.array(known[name]) for name in ("frequency", *SUMS)}, made=made)

    def _require_lines(self, other: ResponseSums) -> None:
        if not np.array_equal(self.frequency, other.frequency):
            raise UserError("signal: sums of different lines cannot be joined")
        if None not in (self.made, other.made) and self.made != other.made:
            raise UserError("signal: sums that are made with other settings cannot be joined")
