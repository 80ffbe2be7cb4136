"""What truly happens in a scene at the nodes of a field that was found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sldvexp.dataset import COMPARED_STRAIN
from sldvexp.lazy import xarray as xr
from sldvexp.virtual_lab.plate import truth_to_dataset


def truth_of(e: Any, tree: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Compute what truly happens in an experiment's scene at the nodes of a field; group ``truth``.

    Parameters
    ----------
    e : Experiment
        With a scene of a plate, and a scan of it.
    tree : mapping of str to xarray.Dataset
        Groups of the run, ``field`` and, if there is one, a strain.
    """
    field = tree["field"]
    images = [part for part in e.scan.parts(e.scan.view_names()[0]) if part.kind == "image"]
    names = (n for n in tree if n == "strain" or n.startswith(f"{COMPARED_STRAIN}/"))
    strain = next((tree[name] for name in names), None)
    hertz = field["frequency"].values
    return truth_to_dataset(
        e.scene,
        field["position"].values,
        hertz,
        images[0].sampling.amplitude_at(hertz),
        None if strain is None else strain["position"].values,
        None if strain is None else strain["frame"].values,
    )
