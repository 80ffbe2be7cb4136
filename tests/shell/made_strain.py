"""A group ``strain`` made by hand, for rooms that show or write one."""

from __future__ import annotations

import numpy as np
import xarray as xr

from sldvexp import dataset
from sldvexp.shell import Isotropic, plane_stress, principal, principal_std, von_mises
from sldvexp.shell.love import STRAINS
from sldvexp.shell.principal import PRINCIPAL

SHEET = Isotropic(0.003)
#: Standard error of every component.
STD = 0.05e-6


def made_strain(
    volume: xr.Dataset, hertz: tuple[float, ...] = (197.0, 439.0), stress: bool = True
) -> xr.Dataset:
    """Smooth strains, of the second frequency with two antinodes, at the nodes of a surface."""
    depth = volume["depth"].values
    count = volume.sizes["node"] // len(depth)
    layer = int(np.abs(depth).argmin())
    position = volume["position"].values[layer * count : (layer + 1) * count]
    prisms = volume["element"].values
    triangle = prisms[: len(prisms) // (len(depth) - 1), :3]
    frame = volume["frame"].values
    x, y, _ = ((position - position.min(axis=0)) / np.ptp(position, axis=0).max()).T
    waves = np.stack(
        [np.sin(np.pi * k * x) * np.sin(np.pi * y) / k for k in range(1, len(hertz) + 1)]
    )
    size = 1e-6 * np.array([3.0, 1.0, 0.5])[None, :, None] * (1 + 0.1j)
    strain = size * waves.T[:, None] + 0.05e-6j
    covariance = np.zeros((2, count, 3, 3, len(hertz)))
    covariance[:, :, range(3), range(3)] = STD**2
    found, (std, direction) = principal(strain), principal_std(strain, covariance)
    arrays = {
        "strain": strain,
        "strain_std": np.full(strain.shape, STD),
        "strain_std_by_part": np.full((2, *strain.shape), STD),
        "confidence": 2 * STD * (1 + x[:, None, None] * np.ones(strain.shape)),
        "middle_strain": 0.1 * strain,
        "bending_strain": 0.9 * strain,
        "principal_strain": found.strain,
        "principal_strain_std": std,
        "principal_confidence": 2 * std,
        "principal_direction": found.direction,
        "principal_direction_std": direction,
        "principal_phase": found.phase,
    }
    if stress:
        own = plane_stress(strain, SHEET.E, SHEET.nu)
        stiff = SHEET.E * STD * (1 + x[:, None, None] * np.ones(strain.shape))
        arrays |= {"stress": own, "stress_std": stiff, "von_mises": von_mises(own)}
        arrays |= {"von_mises_std": stiff[:, 0], "von_mises_confidence": 2 * stiff[:, 0]}
    made = dataset.group(
        "strain",
        {
            "strain_component": list(STRAINS),
            "principal": list(PRINCIPAL),
            "part": ["real", "imaginary"],
            "local_axis": ["t1", "t2", "n"],
            "frequency": hertz,
        },
        position=position,
        coordinate=position[:, :2] - position[:, :2].mean(axis=0),
        frame=frame,
        triangle=triangle,
        **arrays,
    )
    return made.assign_attrs(confidence_level=0.95)
