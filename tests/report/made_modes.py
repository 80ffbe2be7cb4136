"""Groups of modes and of a model put to the test, by hand; every number is another."""

from __future__ import annotations

import numpy as np
import xarray as xr

from sldvexp import dataset
from sldvexp.dataset import Finding, Severity, findings_to_dataset

HERTZ = np.array([197.0, 439.0, 545.0])
LIMITS = "its shapes say nothing of E: those of one material do not change with it"


def modes(hertz: np.ndarray = HERTZ) -> xr.Dataset:
    """Modes with poles of some orders and spectra over 60 lines."""
    rng = np.random.default_rng(2)
    count, line = len(hertz), np.linspace(100.0, 700.0, 60)
    width = 0.01 * line[:, None]
    peaks = 1e-3 * (width / np.hypot(line[:, None] - hertz, width)).sum(axis=1)
    orders = np.repeat(np.arange(4, 12), count + 1)
    natural = np.tile(np.append(hertz, 333.0), 8)
    number = np.tile(np.append(np.arange(1, count + 1), 0), 8)
    return dataset.group(
        "modes",
        {"mode": np.arange(1, count + 1), "line": np.arange(60)},
        natural_frequency=hertz,
        natural_frequency_std=1e-3 * np.arange(1, count + 1),
        damping_ratio=0.01 + 1e-6 * np.arange(count),
        damping_ratio_std=np.full(count, 5e-6),
        complexity=np.full(count, 2e-4),
        complexity_std=np.full(count, 1e-5),
        scale_std=np.full(count, 2e-4),
        phase=np.full(count, 0.01),
        misfit=1.02,
        misfit_p_value=0.3,
        line_frequency=line,
        measured_rms=peaks + 1e-5,
        synthesis_rms=peaks,
        residual_rms=1e-5 * rng.uniform(0.9, 1.1, 60),
        noise_rms=np.full(60, 1e-5),
        candidate_order=orders,
        candidate_frequency=natural + rng.normal(scale=0.3, size=len(natural)),
        candidate_damping=np.full(len(natural), 0.01),
        candidate_stable=(orders > 5).astype(int),
        candidate_mode=np.where(orders > 5, number, 0),
    )


def model(
    shapes: str = "accepted", frequencies: str = "accepted", pair: tuple[int, ...] = (1, 2, 0)
) -> xr.Dataset:
    """A model of four modes, of which the third measured one may be none; one is mixed."""
    mixed = np.zeros((3, 4), complex)
    mixed[1, 2] = 0.02
    return dataset.group(
        "model",
        {"mode": [1, 2, 3], "model_mode": [1, 2, 3, 4]},
        pair=pair,
        measured_frequency=HERTZ,
        model_frequency=[197.2, 438.0, 600.0, 700.0],
        difference=[-1e-3, 2e-3, np.nan],
        mac_of_pair=[0.99990, 0.99950, np.nan],
        mac_expected=[0.99991, 0.99992, np.nan],
        mac_std=[2e-6, 2e-6, np.nan],
        p_value=[0.4, 1e-9, np.nan],
        directed_p_value=[0.9, 1e-12, np.nan],
        mixed=mixed,
        mixed_std=np.full((3, 4), 1e-3),
        frequencies_p_value=0.84,
    ).assign_attrs(shapes=shapes, frequencies=frequencies)


def told_of_model() -> xr.Dataset:
    """A verdict with what was found about the model."""
    made = (
        Finding("model_limits", "model", f"model: {LIMITS}", Severity.note),
        Finding("model_shapes", "model", "model: the shapes are those measured", Severity.note),
    )
    return findings_to_dataset(made)


def pixels(paired: int = 2) -> dict[str, xr.Dataset]:
    """Images of a model of so many paired modes, at some of the pixels of two views."""
    rng = np.random.default_rng(4)
    found = {}
    for view, count in (("left", 6), ("right", 9)):
        shape = (12, 3)
        found[f"modes/image/{view}"] = dataset.group(
            "image",
            {"pixel": np.arange(12), "frequency": HERTZ},
            velocity=rng.normal(size=shape) + 1j * rng.normal(size=shape),
            velocity_std=rng.uniform(1e-3, 2e-3, shape),
        )
        x, y = np.divmod(np.arange(count), 3)
        found[f"model/image/{view}"] = dataset.group(
            "model/image",
            {"pixel": np.arange(count) + 2},
            velocity=rng.normal(size=(count, paired)) + 0j,
            residual=1e-3 * rng.normal(size=(count, paired)) + 0j,
            position=0.1 * np.stack([x, y, 0 * x], axis=1),
        )
    return found


def criteria(short: float = 2.0) -> dict[str, xr.Dataset]:
    """CoMAC, FRAC and CSAC that are so many times as far below one as noise makes them."""
    rng, found = np.random.default_rng(5), {}

    def of(name: str, count: int) -> dict[str, np.ndarray]:
        noise = rng.uniform(1e-4, 2e-4, count)
        std = np.full(count, 1e-5)
        return {name: 1 - short * noise, f"{name}_expected": 1 - noise, f"{name}_std": std}

    for view, image in pixels().items():
        if view.startswith("model/"):
            count = image.sizes["pixel"]
            own = of("comac", count) | of("frac", count)
            made = dataset.group("model/image", {"pixel": image["pixel"].values}, **own)
            found[view] = image.merge(made)
    line = np.linspace(150.0, 600.0, 40)
    lines = dataset.group("model", {"line": np.arange(40)}, line_frequency=line, **of("csac", 40))
    return found | {"model": model().merge(lines)}
