"""Data sets of universal files, as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sldvexp.typing import Array, IntArray

DELIMITER = "    -1"
#: Descriptors of finite elements: thin shell linear triangle and quadrilateral, solid linear wedge.
TRIANGLE, QUADRILATERAL, WEDGE = 91, 94, 112
#: Kinds of data: strain, displacement, velocity, frequency.
STRAIN, DISPLACEMENT, VELOCITY, FREQUENCY = 3, 8, 11, 18
#: Characteristics of values at nodes by how many there are: a vector in space; a symmetric tensor
#: as xx, xy, yy, xz, yz, zz.
CHARACTERISTICS = {3: 2, 6: 4}
#: Kinds of shapes: of a normal mode, of a complex one, of a frequency response.
NORMAL_MODE, COMPLEX_MODE, RESPONSE = 2, 3, 5
#: Location of values in data sets 2414.
AT_NODES = 1
#: Kinds of function: spectrum.
SPECTRUM = 12
REAL, COMPLEX, DOUBLE_COMPLEX = 2, 5, 6
#: Amplitudes of data set 1858: peak.
PEAK = 2
WORLD_SYSTEM = 1
COLOUR = 8


def dataset(number: int, lines: Iterator[str] | Sequence[str]) -> str:
    """Put a data set between its delimiters."""
    return "\n".join([DELIMITER, f"{number:6d}", *lines, DELIMITER, ""])


def units() -> str:
    """Write data set 164: SI."""
    factors = [f"{1.0:25.17E}" * 3, f"{273.15:25.17E}"]
    return dataset(164, [f"{1:10d}{'SI: Meter (newton)':<20}{2:10d}", *factors])


def qualifiers() -> str:
    """Write data set 1858: amplitudes are peak values."""
    flags = [0, 0, PEAK, *[0] * 9]
    nothing = f"{0.0:15.7E}" * 5
    return dataset(
        1858,
        [
            f"{1:12d}" + f"{0:12d}" * 5,
            "".join(f"{f:6d}" for f in flags),
            *[nothing] * 3,
            "",
            "NONE",
        ],
    )


def systems(frames: Array) -> str:
    """Write data set 2420: the world as system 1, then a Cartesian system of every frame.

    Parameters
    ----------
    frames : ndarray, shape (frame, 3, 3)
        Unit rows, the axes in the world.
    """
    lines = [f"{1:10d}", "sldvexp"]
    for label, axes in enumerate([np.eye(3), *frames], start=WORLD_SYSTEM):
        name = "world" if label == WORLD_SYSTEM else f"t1, t2, n of surface node {label - 1}"
        lines += [f"{label:10d}{0:10d}{COLOUR:10d}", name]
        lines += ["".join(f"{x:25.16E}" for x in row) for row in (*axes, np.zeros(3))]
    return dataset(2420, lines)


def systems_18(frames: Array) -> str:
    """Write data set 18, the older `systems`: origin, points on x axis and in xz plane."""
    lines = []
    for label, axes in enumerate([np.eye(3), *frames], start=WORLD_SYSTEM):
        name = "world" if label == WORLD_SYSTEM else f"t1, t2, n of surface node {label - 1}"
        lines += [f"{label:10d}{0:10d}{0:10d}{COLOUR:10d}{1:10d}", name]
        lines += [single([*np.zeros(3), *axes[0]]), single(axes[2])]
    return dataset(18, lines)


def nodes(position: Array, system: IntArray) -> str:
    """Write data set 2411: nodes from 1.

    Parameters
    ----------
    position : ndarray, shape (node, 3), m
    system : ndarray of int, shape (node,)
        The coordinate system of each node's motion.
    """
    lines = []
    for label, (own, place) in enumerate(zip(system, position, strict=True), start=1):
        lines += [f"{label:10d}{WORLD_SYSTEM:10d}{own:10d}{COLOUR:10d}"]
        lines += ["".join(f"{x:25.16E}" for x in place)]
    return dataset(2411, lines)


def nodes_15(position: Array, system: IntArray) -> str:
    """Write data set 15, the older form of `nodes`: six digits."""
    pairs = enumerate(zip(system, position, strict=True), start=1)
    return dataset(
        15,
        [
            f"{label:10d}{WORLD_SYSTEM:10d}{own:10d}{COLOUR:10d}{single(place)}"
            for label, (own, place) in pairs
        ],
    )


def elements(prisms: IntArray, triangles: IntArray) -> str:
    """Write data set 2412: prisms, then triangles, of nodes from 0, which are written from 1."""
    lines = []
    label = 0
    for kind, corners in ((WEDGE, prisms), (TRIANGLE, triangles)):
        for element in corners + 1:
            label += 1
            lines.append(
                f"{label:10d}{kind:10d}{1:10d}{1:10d}{COLOUR:10d}{len(element):10d}\n"
                + "".join(f"{node:10d}" for node in element)
            )
    return dataset(2412, lines)


def quadrilaterals(corners: IntArray) -> str:
    """Write data set 2412: thin shell quadrilaterals of nodes from 0, which are written from 1."""
    lines = [
        f"{label:10d}{QUADRILATERAL:10d}{1:10d}{1:10d}{COLOUR:10d}{4:10d}\n"
        + "".join(f"{node:10d}" for node in element)
        for label, element in enumerate(corners + 1, start=1)
    ]
    return dataset(2412, lines)


def normal_mode(about: Sequence[str], values: Array, frequency: float, number: int) -> str:
    """Write data set 55: a real mode shape at nodes from 1, displacements and rotations or not.

    Parameters
    ----------
    about : sequence of str
        Five lines.
    values : ndarray, shape (node, 3) or (node, 6)
    frequency : float, Hz
    number : int
        Of the mode, from 1.
    """
    count = values.shape[1]
    kinds = (1, NORMAL_MODE, 2 if count == 3 else 3, DISPLACEMENT, REAL, count)
    lines = [
        "".join(f"{n:10d}" for n in kinds),
        f"{2:10d}{4:10d}{1:10d}{number:10d}",
        single([frequency, 0.0, 0.0, 0.0]),
    ]
    for label, row in enumerate(values, start=1):
        lines += [f"{label:10d}", single(row)]
    return dataset(55, [*identification(about), *lines])


def trace_lines(triangles: IntArray, name: str) -> str:
    """Write data set 82: outlines of triangles or lines, the pen lifted between; nodes from 0."""
    closed = np.concatenate([triangles, triangles[:, :1]], axis=1) + 1
    path = np.concatenate([closed, np.zeros((len(closed), 1), int)], axis=1).ravel()
    rows = [path[i : i + 8] for i in range(0, len(path), 8)]
    text = ["".join(f"{node:10d}" for node in row) for row in rows]
    return dataset(82, [f"{1:10d}{len(path):10d}{COLOUR:10d}", name, *text])


def shape(
    about: Sequence[str],
    values: NDArray,
    frequency: float,
    step: int,
    analysis: int,
    quantity: int = VELOCITY,
) -> str:
    """Write data set 55: components at nodes from 1; nodes that lack one are left out.

    Parameters
    ----------
    about : sequence of str
        Five lines.
    values : ndarray, shape (node, 3) or (node, 6)
        Vectors or symmetric tensors, complex or real.
    frequency : float, Hz
    step : int
        From 1.
    analysis : int
        `RESPONSE` or `COMPLEX_MODE`, with the frequency as that of an undamped mode.
    quantity : int
        `VELOCITY` or `STRAIN`.
    """
    if analysis == COMPLEX_MODE:
        numbers = [0.0, 2 * np.pi * frequency, 0.0, 0.0, 0.0, 0.0]
        second = [f"{2:10d}{6:10d}{1:10d}{step:10d}", single(numbers)]
    else:
        second = [f"{2:10d}{1:10d}{1:10d}{step:10d}", single([frequency])]
    lines = [_kinds(analysis, quantity, values), *second, *_at_nodes(values)]
    return dataset(55, [*identification(about), *lines])


def _kinds(analysis: int, quantity: int, values: NDArray) -> str:
    """Write the line that tells of what kind values at nodes are."""
    data, count = COMPLEX if np.iscomplexobj(values) else REAL, values.shape[1]
    kinds = (1, analysis, CHARACTERISTICS[count], quantity, data, count)
    return "".join(f"{n:10d}" for n in kinds)


def _at_nodes(values: NDArray) -> Iterator[str]:
    """Write values at nodes from 1, of those that have all."""
    whole = np.isfinite(values).all(axis=1)
    flat = np.ascontiguousarray(values[whole])
    flat = flat.view(float) if np.iscomplexobj(values) else flat
    for label, row in zip(np.flatnonzero(whole) + 1, flat, strict=True):
        yield f"{label:10d}"
        yield from (single(row[i : i + 6]) for i in range(0, len(row), 6))


def mode_55(
    about: Sequence[str], values: NDArray, pole: complex, number: int, quantity: int = VELOCITY
) -> str:
    """Write data set 55: a mode shape, a normal mode if it is real, else a complex one.

    Parameters
    ----------
    about : sequence of str
        Five lines.
    values : ndarray, shape (node, 3) or (node, 6)
        Nodes that lack a component are left out.
    pole : complex, rad/s
        Its modal mass, or modal A and B, are written as 0, which is unknown.
    number : int
        Of the mode, from 1.
    """
    if np.iscomplexobj(values):
        analysis, reals = COMPLEX_MODE, [pole.real, pole.imag, 0.0, 0.0, 0.0, 0.0]
    else:
        analysis, reals = NORMAL_MODE, [*_frequency_and_damping(pole), 0.0]
        reals.insert(1, 0.0)  # modal mass
    second = f"{2:10d}{len(reals):10d}{1:10d}{number:10d}"
    lines = [_kinds(analysis, quantity, values), second, single(reals), *_at_nodes(values)]
    return dataset(55, [*identification(about), *lines])


def mode_2414(
    about: Sequence[str], values: NDArray, pole: complex, number: int, quantity: int = VELOCITY
) -> str:
    """Write data set 2414, the newer `mode_55`, of the same parameters."""
    analysis = COMPLEX_MODE if np.iscomplexobj(values) else NORMAL_MODE
    hertz, damping = _frequency_and_damping(pole)
    squared = 0.0 if analysis == COMPLEX_MODE else abs(pole) ** 2
    complex_pole = [pole.real, pole.imag] if analysis == COMPLEX_MODE else [0.0, 0.0]
    lines = [
        f"{number:10d}",
        *identification([f"mode {number}, {hertz:.6g} Hz"]),
        f"{AT_NODES:10d}",
        *identification(about),
        _kinds(analysis, quantity, values),
        "".join(f"{n:10d}" for n in (0, 0, 0, 0, 1, number, 0, 0)),
        f"{0:10d}{0:10d}",
        single([0.0, hertz, squared, 0.0, damping, 0.0]),
        single([*complex_pole, 0.0, 0.0, 0.0, 0.0]),
    ]
    return dataset(2414, [*lines, *_at_nodes(values)])


def _frequency_and_damping(pole: complex) -> tuple[float, float]:
    """Give natural frequency, Hz, and damping ratio of a pole, rad/s."""
    return abs(pole) / (2 * np.pi), -pole.real / abs(pole)


def function(
    about: Sequence[str], number: int, node: int, direction: int, frequency: Array, values: NDArray
) -> str:
    """Write data set 58: a complex spectrum of velocity at one node's direction.

    Parameters
    ----------
    about : sequence of str
        Five lines.
    number, node, direction : int
        From 1.
    frequency : ndarray, shape (frequency,), Hz
        Written as first value and step if these have all digits in the format's six.
    values : ndarray of complex, shape (frequency,)
        Finite.
    """
    even = is_even(frequency)
    step = frequency[1] - frequency[0] if even and len(frequency) > 1 else 0.0
    axis = [frequency[0], step, 0.0] if even else [0.0, 0.0, 0.0]
    numbers = np.ascontiguousarray(values, complex).view(float).reshape(-1, 2)
    if even:
        rows = numbers.ravel()
        text = ["".join(f"{x:20.12E}" for x in rows[i : i + 4]) for i in range(0, len(rows), 4)]
    else:
        text = [
            f"{f:13.5E}{a:20.12E}{b:20.12E}" for f, (a, b) in zip(frequency, numbers, strict=True)
        ]
    nothing = _axis(0, 0, "NONE", "NONE")
    return dataset(
        58,
        [
            *identification(about),
            f"{SPECTRUM:5d}{number:10d}{1:5d}{0:10d} {'NONE':<10}{node:10d}{direction:4d}"
            f" {'NONE':<10}{0:10d}{0:4d}",
            f"{DOUBLE_COMPLEX:10d}{len(values):10d}{int(even):10d}{single(axis)}",
            _axis(FREQUENCY, 0, "Frequency", "Hz"),
            _axis(VELOCITY, 1, "Velocity", "m/s"),
            nothing,
            nothing,
            *text,
        ],
    )


def is_even(frequency: Array) -> bool:
    """Tell whether first value and step, with six digits each, give every frequency."""
    step = frequency[1] - frequency[0] if len(frequency) > 1 else 0.0
    first, step = float(single([frequency[0]])), float(single([step]))
    return np.allclose(first + step * np.arange(len(frequency)), frequency, rtol=1e-9, atol=0)


def identification(about: Sequence[str]) -> list[str]:
    """Write five lines of at most 80 characters; an empty one is called NONE."""
    return [(line.encode("ascii", "replace").decode()[:80] or "NONE") for line in about]


def single(numbers: Sequence[float] | Array) -> str:
    """Write numbers in 13 columns with six digits; one of a three-digit exponent is zero."""
    return "".join(f"{0.0 if abs(x) < 1e-99 else x:13.5E}" for x in numbers)


def _axis(kind: int, length: int, label: str, unit: str) -> str:
    """Write the line of an axis of a function."""
    return f"{kind:10d}{length:5d}{0:5d}{0:5d} {label:<20} {unit:<20}"
