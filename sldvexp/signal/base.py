"""Contract of the group `signal`: samples of a whole image in, complex pixels with noise out."""

from __future__ import annotations

from abc import ABC, abstractmethod

from numpy.typing import ArrayLike

from sldvexp.signal.complex_image import ComplexImage


class SignalEstimator(ABC):
    """Base of what turns samples into complex velocity.

    A strategy is a dataclass of its settings that implements `demodulate`. What it returns must
    keep these promises, which every registered estimator is tested for:

    - Peak amplitudes in m/s of ``exp(+i w t)``, phase relative to the reference channel.
    - `ComplexImage.std` holds for the real and the imaginary part each, and is told by the samples.
    - A pixel that cannot be trusted keeps its value and is flagged; none is left out.
    - A pixel's bits depend on its own samples, not on those that were given with it, unless a
      setting says that pixels are treated together.
    """

    @abstractmethod
    def demodulate(
        self,
        samples: ArrayLike,
        times: ArrayLike,
        frequencies: ArrayLike,
        *,
        channel_axis: int = 1,
        volts_per_count: ArrayLike = 1.0,
        limits: ArrayLike | None = None,
        quality: ArrayLike | None = None,
    ) -> ComplexImage:
        """Turn the samples of a whole image into complex pixels.

        Parameters
        ----------
        samples : array_like, shape (pixel, channel, sample) or (channel, pixel, sample)
            Counts; channels are velocity, reference.
        times : array_like, shape (sample,), s
        frequencies : array_like, shape (frequency,), Hz
            Of the excitation, as set.
        channel_axis : int
            Which axis of the samples is that of the channels, 0 or 1.
        volts_per_count : array_like, shape () or (2,)
            Of each channel.
        limits : array_like, shape (2,) or (2, 2), optional
            Smallest and largest sample that the converter can give, for each channel; one there is
            saturated. Integers have the limits of their type unless given; floats have none.
        quality : array_like of bool, shape (pixel,), optional
            False where the instrument itself reported a lost signal.

        Raises
        ------
        UserError
            If the samples cannot carry what is asked of them.
        """
