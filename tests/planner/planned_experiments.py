"""What tests of plans set."""

from __future__ import annotations

#: A field so coarse that its bounds take a moment.
SMALL = ("volume.shape=[9,7]", "volume.layers=3", "plan.candidates=300")
