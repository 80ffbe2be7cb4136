"""What truly happens in a scene at the nodes of a field that was found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sldvexp.dataset import COMPARED_STRAIN
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array
from sldvexp.virtual_lab.plate import VibratingPlate, truth_to_dataset


def middle_truth_of(e: Any, tree: Mapping[str, xr.Dataset], truth: xr.Dataset) -> xr.Dataset:
    """Compute the same of the plate's middle surface, at nodes of a volume made around it.

    Parameters
    ----------
    truth : xarray.Dataset
        Of the measured face, see `truth_of`.
    """
    plate, position = VibratingPlate.built(e.scene.plate), tree["field"]["position"].values
    hertz, depth = truth["frequency"].values, tree["volume"]["depth"].values
    volts = _amplitude(e, hertz)
    velocity = volts * np.stack([plate.middle_velocity(position, f) for f in hertz], axis=-1)
    height = depth.repeat(truth.sizes["node"] // len(depth))
    return truth.assign(
        velocity=(truth["velocity"].dims, velocity), height=(truth["height"].dims, height)
    )


def _amplitude(e: Any, hertz: Array) -> Array:
    """Give the excitation's amplitude at each frequency, V."""
    images = [part for part in e.scan.parts(e.scan.view_names()[0]) if part.kind == "image"]
    return np.asarray(images[0].sampling.amplitude_at(hertz))


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
    names = (n for n in tree if n == "strain" or n.startswith(f"{COMPARED_STRAIN}/"))
    strain = next((tree[name] for name in names), None)
    hertz = field["frequency"].values
    return truth_to_dataset(
        e.scene,
        field["position"].values,
        hertz,
        _amplitude(e, hertz),
        None if strain is None else strain["position"].values,
        None if strain is None else strain["frame"].values,
    )
