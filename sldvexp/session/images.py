"""One view of a structure: pixels to a velocity image (Section 3.2.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.scan import ImageScan
from sldvexp.session.camera import ViewContext, line_name
from sldvexp.session.records import added, once_more
from sldvexp.signal import (
    ComplexImage,
    Flag,
    RecordFault,
    Response,
    ResponseImage,
    ResponseSums,
    find_response_findings,
    instrument_fault,
)
from sldvexp.typing import Array, IntArray

#: Of an image's lines in the journal.
NAME = "image"
#: Of lines of pixels that are measured once more.
ONCE_MORE = "once_more"
#: Share of the pixels from which a fault is the instrument's.
MOST = 0.5
#: What a flag of most pixels of averaged records tells about the instrument.
FAULTS = {
    Flag.reference_missing: "the reference channel has no signal; the generator's output is off, "
    "its cable is not plugged in, or triggers were missed",
    Flag.saturated: "records are over range; choose a larger range or a smaller amplitude",
    Flag.dropped_out: "no light comes back; the laser's shutter is closed, or the beam falls "
    "beside everything",
}
#: Level at which a record's constant is judged; its p-value, which is kept, needs none.
TESTED = 0.95


def scan_image(scan: ImageScan, at: ViewContext) -> dict[str, xr.Dataset]:
    """Scan the image of a view; the group ``image/<view>``.

    Raises
    ------
    UserError
        If no pixel of it is good; it says what to look at.
    """
    at.camera.sample(scan.sampling)
    scan = scan.in_steps(at.laser, at.target, at.poses)
    lines: Sequence[IntArray] = scan.lines(at.view)
    if at.view in at.poses:  # circles have corrected the rough pose, by estimates
        pitch = max(float(np.abs(np.diff(line, axis=0)).max(initial=0)) for line in lines)
        lines = at.camera.placed(NAME, lines, within=pitch, lost=1)
    every = np.concatenate(lines)
    image: ComplexImage | ResponseImage
    if scan.sampling.broadband:
        image = _responses(at, lines, every, scan.sampling.spare)
    else:
        image = at.camera.image(NAME, lines, in_part=True)
    if (image.flags != 0).all():
        why = _fault(image) or "for more than one reason"
        raise UserError(
            f"scan: in the image of the view {at.view} {describe_flagged_pixels(image.flags)}: "
            f"{why}; put it right, then delete {at.camera.journal.folder / NAME}_* and resume "
            "the run"
        )
    dac = every[: len(image.flags)]  # all, unless the rest was skipped
    angle = at.laser.angle_from_dac(dac)
    if isinstance(image, ResponseImage):
        group = response_to_dataset(image, dac, angle)
    else:
        group = image_to_dataset(image, dac, angle, scan.sampling.frequency)
    if scan.shape(at.view) and len(dac) == len(every):
        group.attrs["shape"] = [len(lines), len(lines[0])]
    return {f"image/{at.view}": group}


def _responses(
    at: ViewContext, lines: Sequence[IntArray], every: IntArray, spare: float
) -> ResponseImage:
    """Average the records of all pixels, then those of the worst once more."""
    camera = at.camera
    found = [s for s in camera.scanned(NAME, lines, in_part=True) if isinstance(s, ResponseSums)]
    sums = ResponseSums.concatenated(found)
    if not camera.skipped:
        worst = once_more(sums, every, camera.acquisition.seconds, spare)
        for place, (pixels, dac) in enumerate(worst):
            more = camera.once_more(ONCE_MORE, place, dac)
            assert isinstance(more, ResponseSums)
            sums = added(sums, more, pixels)
    signal, design = camera.signal, camera.acquisition.drive
    assert isinstance(signal, Response)
    assert design is not None
    at.findings.extend(find_response_findings(sums, design, at.view, signal.mains))
    return signal.image(sums, design)


def _fault(image: ComplexImage | ResponseImage) -> str:
    """Say what is wrong with the instrument, told by pixels of which none is good."""
    if isinstance(image, ComplexImage):
        return instrument_fault(image)
    for flag, why in FAULTS.items():
        if (image.flags & flag != 0).mean() > MOST:
            return why
    return ""


def image_lines(scan: ImageScan, view: str) -> dict[str, int]:
    """List names and pixels of the lines of a view's image."""
    return {line_name(NAME, k): len(dac) for k, dac in enumerate(scan.lines(view))}


def image_to_dataset(
    image: ComplexImage,
    dac: IntArray,
    angle: Array,
    frequency: list[float],
) -> xr.Dataset:
    """Make the group ``image/<view>`` of a velocity image.

    Parameters
    ----------
    dac : ndarray of int, shape (pixel, 2), steps
    angle : ndarray, shape (pixel, 2), rad
    frequency : list of float, Hz
        As set, so that all views have the same; `refined_frequency` says what was found.

    Returns
    -------
    xarray.Dataset
        Flagged pixels keep their values. Attribute ``summary`` counts them.
    """
    found = image.refined
    fits = (image.velocity_fit, image.reference_fit)
    tests = [fit.intercept_test(TESTED) for fit in fits]
    tried = [fit.harmonics for fit in fits if fit.harmonics]
    group = dataset.group(
        "image",
        {
            "pixel": np.arange(len(dac)),
            "frequency": np.array(frequency),
            "channel": ["velocity", "reference"],
            **({"harmonic": np.arange(2, 2 + tried[0].p_value.shape[1])} if tried else {}),
        },
        velocity=image.velocity,
        velocity_std=image.std,
        uncorrected=image.uncorrected,
        refined_frequency=found.frequencies if found else None,
        refined_frequency_std=found.std if found else None,
        angle=angle,
        dac=dac,
        flags=image.flags,
        f_statistic=np.stack([test.statistic for test in tests], axis=1),
        f_p_value=np.stack([test.p_value for test in tests], axis=1),
        harmonics=np.stack([each.used for each in tried], axis=1) if tried else None,
        harmonic_p_value=np.stack([each.p_value for each in tried], axis=1) if tried else None,
        reference_amplitude=_reference_amplitude(image),
    )
    return _with_flags(group, image.flags)


def response_to_dataset(image: ResponseImage, dac: IntArray, angle: Array) -> xr.Dataset:
    """Make the group ``image/<view>`` of response functions.

    Parameters
    ----------
    dac : ndarray of int, shape (pixel, 2), steps
    angle : ndarray, shape (pixel, 2), rad

    Returns
    -------
    xarray.Dataset
        As `image_to_dataset` makes it, with the records behind each pixel.
    """
    design = image.design
    group = dataset.group(
        "image",
        {
            "pixel": np.arange(len(dac)),
            "frequency": image.frequencies,
            "fault": [str(fault.name) for fault in RecordFault],
        },
        velocity=image.velocity,
        velocity_std=image.std,
        angle=angle,
        dac=dac,
        flags=image.flags,
        reference_amplitude=image.reference_amplitude,
        coherence=image.coherence,
        records=image.records,
        left_out=image.left_out,
    )
    group.attrs |= {
        "excitation": design.excitation.kind.name,
        "estimator": image.estimator.name,
        "record_seconds": design.record_seconds,
    }
    if design.excitation.decay > 0:
        group.attrs["window_decay"] = design.excitation.decay
    return _with_flags(group, image.flags)


def _reference_amplitude(image: ComplexImage) -> Array:
    """Take the median of the good pixels' references, or of all if none is good, V."""
    amplitude = np.abs(image.reference_fit.phasor)
    good = image.flags == 0
    return np.asarray(np.median(amplitude[good] if good.any() else amplitude, axis=0), float)


def _with_flags(group: xr.Dataset, flags: NDArray[np.uint8]) -> xr.Dataset:
    """Say what flags mean, and how many pixels have them."""
    group["flags"].attrs |= {
        "flag_masks": np.array([flag.value for flag in Flag], np.uint8),
        "flag_meanings": " ".join(str(flag.name) for flag in Flag),
    }
    group.attrs["summary"] = describe_flagged_pixels(flags)
    return group


def describe_flagged_pixels(flags: NDArray[np.uint8]) -> str:
    """Say how many pixels are flagged, and by which kinds.

    Examples
    --------
    >>> flag_text(np.array([0, 1, 3], np.uint8))
    '2 of 3 pixels are flagged (saturated 2, dropped_out 1)'
    """
    counts = {flag.name: int(np.sum(flags & flag != 0)) for flag in Flag}
    kinds = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
    told = f"{np.sum(flags != 0)} of {len(flags)} pixels are flagged"
    return f"{told} ({kinds})" if kinds else told
