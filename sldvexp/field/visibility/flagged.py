"""Why pixels are flagged, and what may be done about it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.visibility.view import View
from sldvexp.session.images import flag_text
from sldvexp.signal.pixel_quality import Flag

#: Part of a view's samples that lie at flagged pixels, from which that is worth saying.
NOTABLE = 0.1

#: What may be done, by the flag of most pixels.
REMEDIES = {
    Flag.saturated: "excite less, or choose a wider range of the velocity and of the converter",
    Flag.dropped_out: "focus or treat the surface, or raise signal.flags.dropout_factor",
    Flag.reference_missing: "connect the reference to its channel, or lower "
    "signal.flags.reference_minimum if it really is so small",
    Flag.non_finite: "the instrument gave samples that are no numbers",
    Flag.poor_fit: "is scan.sampling.frequency the one that is driven, and the reference a sine?",
}


def why(*views: View) -> str:
    """How many pixels of some views are flagged, by which flags, and what to do.

    For example ``9 of 9 pixels are flagged (saturated 9): excite less, or ...``.
    """
    flags = np.concatenate([view.flags for view in views]).astype(int)
    counts = {flag: int(np.sum(flags & flag != 0)) for flag in Flag}
    most = max(counts, key=lambda flag: counts[flag])
    told = flag_text(flags)
    return f"{told}: {REMEDIES[most]}" if counts[most] else told


def require_usable(views: Sequence[View]) -> None:
    """Every image has pixels that are not flagged.

    Raises
    ------
    UserError
        If one has none; it says why.
    """
    for view in views:
        if len(view.flags) and not view.usable.any():
            raise UserError(f"view {view.name}: {why(view)}; or leave the view out")
