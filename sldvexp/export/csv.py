"""`export=csv`: a table of all velocities."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.config.registry import register
from sldvexp.export.base import Export
from sldvexp.export.results import Results
from sldvexp.files import whole_or_nothing
from sldvexp.lazy import pandas as pd


@register("export", "csv")
@dataclass
class Csv(Export):
    """A row for each node or point, component and frequency, with units in the header.

    Positions are there where the run knows them. Numbers have all their digits. What is not
    determined is empty, and its ``determined`` is 0.
    """

    suffix = ".csv"

    def write(self, results: Results, path: Path) -> None:
        """Write the table; nodes count from 1."""
        shape = results.velocity.shape
        node, component, step = (i.ravel() for i in np.indices(shape))
        columns: dict[str, Any] = {
            "node" if results.mesh else "point": np.array(results.names)[node]
        }
        if results.position is not None:
            for axis, values in zip("xyz", results.position.T, strict=True):
                columns[f"{axis}_m"] = values[node]
        frequency = np.full(1, np.nan) if results.frequency is None else results.frequency
        columns |= {
            "component": np.array(results.components)[component],
            "frequency_hz": frequency[step],
            "real_m_per_s": results.velocity.real.ravel(),
            "imag_m_per_s": results.velocity.imag.ravel(),
        }
        names = {"velocity_std": "std_m_per_s", "confidence": "confidence_m_per_s"}
        columns |= {names[k]: array.ravel() for k, array in results.bounds.items()}
        columns["determined"] = results.observable[node, component].astype(int)
        with whole_or_nothing(path) as beside:
            pd.DataFrame(columns).to_csv(beside, index=False)
