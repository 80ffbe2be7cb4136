"""All views of a calibration object, one after the other, through any instrument that scans."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.instrument.protocol import Acquisition
from sldvexp.paths import locate
from sldvexp.scan.files import read_centres
from sldvexp.session.camera import Camera
from sldvexp.session.circles import edge_group, scan_circles
from sldvexp.session.journal import Journal, require_same

#: Of the dissertation's instrument (Section 3.2.1).
PIXELS_PER_SECOND = 6.0

if TYPE_CHECKING:
    from sldvexp.scan.calibration import Calibration, Centres, Sampling


def scan_views(experiment: Any, journal: Path) -> dict[str, xr.Dataset]:
    """Scan the calibration object from every view.

    Parameters
    ----------
    experiment : Experiment
        With ready plugins: scene, laser, target, scan, instrument and signal, and the seed.
    journal : Path
        Folder for finished scan lines; what it has is not scanned again.

    Returns
    -------
    dict of str to xarray.Dataset
        The groups ``edge/<view>``.
    """
    e = experiment
    scan: Calibration = e.scan
    rough = {view: _rough(centres) for view, centres in scan.views.items()}
    require_same(journal, (e.seed, e.target, e.laser, e.scene, scan, type(e.instrument).__name__))
    print(_estimate(scan, rough))
    found = {}
    for view, centres in rough.items():
        if len(rough) > 1 and not e.instrument.takes_views_itself:
            _ask_for(view)
        with e.instrument.open(e.scene, e.laser, e.target, seed=e.seed, view=view) as instrument:
            acquisition = acquisition_of(scan.sampling)
            instrument.configure(acquisition)
            camera = Camera(instrument, e.signal, acquisition, Journal(journal / view))
            edges = scan_circles(camera, scan, centres, e.laser)
        found[f"edge/{view}"] = edge_group(edges)
    return found


def acquisition_of(sampling: Sampling) -> Acquisition:
    """What the instrument is told about each pixel."""
    s = sampling
    return Acquisition(s.rate, s.samples, tuple(s.frequency), s.amplitude)


def _ask_for(view: str) -> None:
    """Wait until the operator has moved the instrument.

    Raises
    ------
    UserError
        If there is nobody to ask.
    """
    try:
        input(f"Move the instrument to the view {view}, then press Enter: ")
    except EOFError:
        raise UserError(
            f"scan: the instrument must be moved to the view {view}, but nobody is at the terminal"
        ) from None


def _estimate(scan: Calibration, rough: dict[str, NDArray[np.int64]]) -> str:
    """How long the session takes at least, and at the dissertation's six pixels a second."""
    pixels = sum(scan.pixels(len(centres)) for centres in rough.values())
    seconds = pixels * scan.sampling.samples / scan.sampling.rate
    return (
        f"scan: {pixels} pixels in {len(rough)} views, {seconds:.0f} s of samples "
        f"({pixels / PIXELS_PER_SECOND / 60:.0f} min on an instrument of 6 pixels a second)"
    )


def _rough(centres: Centres) -> NDArray[np.int64]:
    """Rough centres of a view, shape (circle, 2), steps."""
    if centres.path:
        return read_centres(locate(centres.path))
    return np.array(centres.dac, dtype=np.int64)
