"""`export=csv`: a table of all velocities."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.export.base import Export
from sldvexp.export.velocities import (
    bounds_of,
    frequencies_of,
    is_field,
    positions_of,
    velocities_of,
)
from sldvexp.lazy import pandas as pd
from sldvexp.writing import whole_or_nothing


@register("export", "csv")
@dataclass
class Csv(Export):
    """A row for each node or point, component and frequency, with units in the header.

    Positions are there where the run knows them. Numbers have all their digits. What is not
    determined is empty, and its ``determined`` is 0.
    """

    suffix = ".csv"

    def write(self, run: RunData, path: Path) -> None:
        """Write the table; nodes count from 1."""
        found = velocities_of(run)
        velocity = found["velocity"].values
        node, component, step = (i.ravel() for i in np.indices(velocity.shape))
        place = "node" if is_field(run) else "point"
        columns: dict[str, Any] = {place: found["place"].values[node]}
        if (position := positions_of(run)) is not None:
            for axis, values in zip("xyz", position.T, strict=True):
                columns[f"{axis}_m"] = values[node]
        known = frequencies_of(found)
        frequency = np.full(1, np.nan) if known is None else known
        columns |= {
            "component": found["component"].values[component],
            "frequency_hz": frequency[step],
            "real_m_per_s": velocity.real.ravel(),
            "imag_m_per_s": velocity.imag.ravel(),
        }
        names = {"velocity_std": "std_m_per_s", "confidence": "confidence_m_per_s"}
        columns |= {names[k]: array.ravel() for k, array in bounds_of(found).items()}
        columns["determined"] = found["observable"].values[node, component].astype(int)
        with whole_or_nothing(path) as beside:
            pd.DataFrame(columns).to_csv(beside, index=False)
