"""What scans have in common that a person does: points the beam, or measures where it falls."""

from __future__ import annotations

from sldvexp.scan.base import ScanPart


class PersonPart(ScanPart):
    """Base of scans without samples: a person at the instrument gives what is asked for."""

    def pixel_count(self, view: str) -> int:
        """See `ScanPart`; nothing is sampled."""
        return 0

    def seconds(self, view: str) -> float:
        """See `ScanPart`; nobody knows how long a person takes."""
        return 0.0
