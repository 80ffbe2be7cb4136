"""`check=image_truth`: pixels of a view against what truly moves under their beams.

Over the good pixels p of a line, with the truth t_p, the errors e_p and their standard errors s_p,
the bias is the common factor that pixels are off by,

    b = sum conj(t_p) e_p / sum |t_p|^2,

whose real and imaginary part each have the standard error
``sqrt(sum |t_p|^2 s_p^2) / sum |t_p|^2``.

The truth is that of the beams' axes, as the virtual lab's mirrors truly point without jitter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, BoolArray
from sldvexp.virtual_lab import Scene, VirtualLab


@register("check", "image_truth")
@dataclass
class ImageTruth(Check):
    """How far images are from the truth, and how often their bounds hold.

    Parameters
    ----------
    confidence : float
        Of the intervals of real and imaginary part.
    """

    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        checks.probability("confidence", self.confidence)
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find bias and coverage of each view at each line, and those at all peaks and lines."""
        e, images = run.experiment, run.below("image", "velocity_std")
        if e is None or not isinstance(e.scene, Scene) or not images or e.laser is None:
            raise UserError(
                "check=image_truth needs images of the virtual lab: choose a scene, a scan and "
                "instrument=simulated"
            )
        lab = VirtualLab(e.scene, e.laser, e.target, e.seed)
        found = [self._of_view(lab, view, image) for view, image in images.items()]
        frequency = next(iter(images.values()))["frequency"].values
        return dataset.group(
            "examined/image_truth",
            {"view": list(images), "frequency": frequency},
            **{name: np.stack([each[name] for each in found]) for name in found[0]},
        )

    def _of_view(self, lab: VirtualLab, view: str, image: xr.Dataset) -> dict[str, Array]:
        """Compare one view."""
        lab.use_view(view)
        good = image["flags"].values == 0
        if not good.any():
            raise UserError(f"check=image_truth: no pixel of the view {view} is good")
        played = image["reference_amplitude"].values
        truth = lab.true_velocity(image["dac"].values, image["frequency"].values) * played
        error = (image["velocity"].values - truth)[good]
        std, truth = image["velocity_std"].values[good], truth[good]
        bound = std * self._factor(image, good)
        covered = np.stack([np.abs(error.real) <= bound, np.abs(error.imag) <= bound])
        power = (np.abs(truth) ** 2).sum(axis=0)
        power[power == 0] = np.nan  # where nothing moves there is no factor
        bias = np.abs((truth.conj() * error).sum(axis=0)) / power
        return {
            "bias": bias,
            "bias_std": np.sqrt((np.abs(truth) ** 2 * std**2).sum(axis=0)) / power,
            "covered": covered.mean(axis=(0, 1)),
            "largest_bias": np.array(bias[peaks(power)].max(initial=0.0)),
            "covered_in_all": np.array(covered.mean()),
            "flagged": np.array(1 - good.mean()),
        }

    def _factor(self, image: xr.Dataset, good: BoolArray) -> Array:
        """Compute half-widths over standard errors, (pixel, 1): Student's with few records."""
        p = (1 + self.confidence) / 2
        if "records" not in image:
            return np.full((int(good.sum()), 1), scipy.special.ndtri(p))
        dof = 2 * (image["records"].values[good] - 1)
        return np.asarray(scipy.special.stdtrit(dof, p)[:, None], float)


def peaks(power: Array) -> BoolArray:
    """Find lines at which more moves than at the two beside them, shape (line,).

    Examples
    --------
    >>> peaks(np.array([9.0, 1.0, 4.0, 2.0, 3.0])).tolist()
    [False, False, True, False, False]
    """
    rises = np.pad(np.diff(power) > 0, 1)
    falls = np.pad(np.diff(power) <= 0, 1)
    return np.asarray(rises[:-1] & falls[1:])
