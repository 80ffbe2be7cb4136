"""The tutorial's files are what is made here, and its experiments find the shape that they hold.

``SLDVEXP_WRITE_TUTORIAL=1 pytest -n0 tests/io/uff/test_tutorial.py`` writes the files anew.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

DATA = Path(__file__).parents[3] / "conf" / "data"
MM = 1e-3
#: Where a single-point vibrometer stood on its tripod, m, and was aimed at one point after another.
ORIGINS = {"front": (0.1, 0.0, 1.5), "left": (-0.9, -0.2, 1.1), "below": (0.3, -0.9, 1.1)}
COLUMNS, ROWS = 7, 5
FREQUENCY = 80.0 + 8.0 * np.arange(24)
#: Natural frequency, Hz, and damping of two modes.
MODES = ((120.0, 0.02), (208.0, 0.015))
#: Force, N, and standard error of the mobility's real and imaginary part, m/s per N.
FORCE, NOISE = 2.0, 5e-6


def positions():
    """A panel of a cylinder, 0.30 m by 0.20 m, row by row; shape (point, 3), m."""
    arc, y = np.meshgrid(np.linspace(-0.15, 0.15, COLUMNS), np.linspace(-0.1, 0.1, ROWS))
    radius = 0.5
    x, z = radius * np.sin(arc / radius), radius * (np.cos(arc / radius) - 1)
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=-1)


def quadrilaterals():
    return [
        [
            r * COLUMNS + c + 1,
            r * COLUMNS + c + 2,
            (r + 1) * COLUMNS + c + 2,
            (r + 1) * COLUMNS + c + 1,
        ]
        for r in range(ROWS - 1)
        for c in range(COLUMNS - 1)
    ]


def mobility():
    """Velocity per force, shape (point, 3, frequency), m/s per N."""
    x, y, _ = positions().T
    bending = np.cos(np.pi * x / 0.3)
    bend = np.stack([-0.3 * np.sin(np.pi * x / 0.3), 0 * x, bending], axis=-1)
    twist = np.stack([-2.0 * y, 1.5 * x, 60.0 * x * y], axis=-1)
    omega = 2 * np.pi * FREQUENCY
    total = np.zeros((len(x), 3, len(omega)), complex)
    for shape, (f, damping) in zip((bend, twist), MODES, strict=True):
        own = 2 * np.pi * f
        total += (
            shape[..., None] * 0.05 * 1j * omega / (own**2 - omega**2 + 2j * damping * own * omega)
        )
    return total


def files(uff):
    """The bytes of the three files."""
    rng = np.random.default_rng(20)
    position, v = positions(), mobility()
    made = {}
    for name, origin in ORIGINS.items():
        towards = np.array(origin) - position
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        seen = np.einsum("pi,pif->pf", towards, v)
        seen += NOISE * (rng.normal(size=seen.shape) + 1j * rng.normal(size=seen.shape))
        common = {
            "first": FREQUENCY[0],
            "step": FREQUENCY[1] - FREQUENCY[0],
            "unit": "mm/s",
            "direction": 0,
            "words": (f"tutorial, {name}", "H1", "made up", "", ""),
        }
        write = uff.binary if name == "left" else uff.function
        parts = [uff.units(MM, "mm"), uff.nodes(position / MM), uff.elements(quadrilaterals())]
        parts += [write(n, row / MM, **common) for n, row in enumerate(seen, 1)]
        made[f"tutorial_{name}.uff"] = b"".join(parts)
    return made


def test_files_are_what_is_made_here(uff):
    made = files(uff)
    if os.environ.get("SLDVEXP_WRITE_TUTORIAL") == "1":
        for name, content in made.items():
            (DATA / name).write_bytes(content)
    for name, content in made.items():
        assert (DATA / name).read_bytes() == content
    assert sum(map(len, made.values())) < 300_000


def wanted():
    """The true velocities at 120 and 208 Hz, shape (point, 3, 2), m/s."""
    lines = [int(np.argmin(abs(FREQUENCY - f))) for f in (120.0, 208.0)]
    return FORCE * mobility()[..., lines]


def test_the_shape_of_the_points(sldvexp):
    done = sldvexp("experiment=tutorial_points")
    assert done.status == 0, done.err
    point, seen = done.tree["point"], done.tree["line_of_sight"]
    np.testing.assert_allclose(seen["position"].values, positions(), atol=1e-12)
    assert seen["triangle"].shape == (2 * (COLUMNS - 1) * (ROWS - 1), 3)
    assert seen.attrs["import_reference"] == "2 N"
    error = point["velocity"].values - wanted()
    part = np.stack([error.real, error.imag]) / point["velocity_std"].values
    # The bounds' std is that of the configuration, which is the one that the files were made with.
    count = part.size
    assert abs(part.std() - 1) < 4 / np.sqrt(2 * count)
    assert abs(part).max() < 5


@pytest.mark.whole
def test_the_shape_of_the_field(sldvexp):
    done = sldvexp("experiment=tutorial")
    assert done.status == 0, done.err
    field = done.tree["field"]
    middle = field["velocity"].values.reshape(3, len(positions()), 3, 2)[1]
    x, _, z = positions().T
    normal = np.stack([x, 0 * x, z + 0.5], axis=-1) / 0.5
    truth = np.einsum("pi,pif->pf", normal, wanted())
    error = abs(middle[:, 2] - truth).max(axis=0) / abs(truth).max(axis=0)
    assert (error < 0.06).all(), error  # what linear elements of 50 mm leave of these modes
