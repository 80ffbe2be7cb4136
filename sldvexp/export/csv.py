"""`export=csv`: a table of all velocities, and one of the strains."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.export.base import VelocityExport
from sldvexp.export.strains import REAL, beside, strain_of
from sldvexp.export.velocities import (
    bounds_of,
    frequencies_of,
    is_field,
    positions_of,
    velocities_of,
)
from sldvexp.lazy import pandas as pd
from sldvexp.lazy import xarray as xr
from sldvexp.writing import whole_or_nothing


@register("export", "csv")
@dataclass
class Csv(VelocityExport):
    """A row for each node or point, component and frequency, with units in the header.

    Positions are there where the run knows them. Numbers have all their digits. What is not
    determined is empty, and its ``determined`` is 0. Strains have a table of their own,
    ``<name>_strain.csv``: a row for each quantity (strain of the face, principal strains and their
    direction, von Mises stress), place of the surface, component and frequency.
    """

    suffix = ".csv"

    def write(self, run: RunData, path: Path) -> None:
        """Write the tables; nodes and places count from 1."""
        if (strain := strain_of(run)) is not None:
            with whole_or_nothing(beside(path)) as partner:
                _strains(strain).to_csv(partner, index=False)
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
        with whole_or_nothing(path) as whole:
            pd.DataFrame(columns).to_csv(whole, index=False)


def _strains(strain: xr.Dataset) -> pd.DataFrame:
    """Make a row for each quantity, place, component and frequency."""
    tables = []
    position, along = strain["position"].values, strain["coordinate"].values
    for name in ("strain", *(n for n in REAL if n in strain)):
        values, std = strain[name], strain[f"{name}_std"].values
        components = [d for d in ("strain_component", "principal") if d in values.dims]
        labels = strain[components[0]].values if components else np.array([""])
        shape = (strain.sizes["place"], len(labels), strain.sizes["frequency"])
        place, component, step = (i.ravel() for i in np.indices(shape))
        columns: dict[str, Any] = {"quantity": name, "place": place + 1}
        columns |= {f"{axis}_m": position[place, i] for i, axis in enumerate("xyz")}
        columns |= {f"{axis}_m": along[place, i] for i, axis in enumerate("st")}
        flat = values.values.ravel()
        columns |= {
            "component": labels[component],
            "frequency_hz": strain["frequency"].values[step],
            "real": flat.real,
            "imag": flat.imag if np.iscomplexobj(flat) else np.nan,
            "std": std.ravel(),
            "unit": values.attrs["units"],
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables)
