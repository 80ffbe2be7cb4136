"""Universal files as other programs write them, one function a data set."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

MARK = b"    -1\n"


def data_set(kind, *lines):
    """A data set of text lines."""
    text = b"".join((line if isinstance(line, bytes) else line.encode()) + b"\n" for line in lines)
    return MARK + f"{kind:6d}\n".encode() + text + MARK


def units(length=1.0, name="SI", force=1.0):
    """Data set 164; `length` is one unit of length in m, `force` one of force in N."""
    numbers = "".join(f"{v:25.17E}".replace("E", "D") for v in (1 / length, 1 / force, 1.0))
    return data_set(164, f"{9:10d}{name:20s}{1:10d}", numbers, f"{0.0:25.17E}".replace("E", "D"))


def nodes(positions, first=1, system=0, motion=0):
    """Data set 2411; positions in the file's unit, labels from `first` or of a mapping."""
    if not isinstance(positions, dict):
        positions = {first + i: p for i, p in enumerate(positions)}
    lines = []
    for label, p in positions.items():
        lines.append(f"{label:10d}{system:10d}{motion:10d}{11:10d}")
        lines.append("".join(f"{v:25.16E}".replace("E", "D") for v in p))
    return data_set(2411, *lines)


def nodes_15(positions, first=1, system=0, motion=0):
    """Data set 15."""
    return data_set(
        15,
        *(
            f"{first + i:10d}{system:10d}{motion:10d}{11:10d}" + "".join(f"{v:13.5E}" for v in p)
            for i, p in enumerate(positions)
        ),
    )


def elements(corners, kind=94):
    """Data set 2412: thin shells, quadrilaterals (94) or triangles (91)."""
    lines = []
    for i, element in enumerate(corners, 1):
        lines.append("".join(f"{v:10d}" for v in (i, kind, 1, 1, 7, len(element))))
        lines.append("".join(f"{v:10d}" for v in element))
    return data_set(2412, *lines)


def trace(labels):
    """Data set 82; 0 lifts the pen."""
    rows = [labels[i : i + 8] for i in range(0, len(labels), 8)]
    lines = ["".join(f"{v:10d}" for v in row) for row in rows]
    return data_set(82, f"{1:10d}{len(labels):10d}{1:10d}", "outline", *lines)


def systems(axes_and_origins, kind=0):
    """Data set 2420: {label: (axes, origin)}."""
    lines = [f"{1:10d}", "part"]
    for label, (axes, origin) in axes_and_origins.items():
        lines += [f"{label:10d}{kind:10d}{8:10d}", f"CS{label}"]
        lines += ["".join(f"{v:25.16E}" for v in row) for row in [*axes, origin]]
    return data_set(2420, *lines)


def qualifiers(amplitude):
    """Data set 1858."""
    return data_set(
        1858,
        "".join(f"{v:12d}" for v in (1, 0, 0, 0, 0, 0)),
        "".join(f"{v:6d}" for v in (0, 1, amplitude, 0, 0, 0, 0, 0, 0, 0, 0, 0)),
        *["".join(f"{0.0:15.7E}" for _ in range(5))] * 3,
        "",
        "",
    )


def header(
    node,
    count,
    *,
    direction=3,
    kind=4,
    type_=5,
    even=True,
    first=0.0,
    step=1.0,
    quantity=11,
    unit="m/s",
    words=("made", "", "", "", ""),
    reference=(1, 3),
    reference_kind=13,
    reference_unit="N",
    axis=None,
):
    """The eleven lines of a data set 58."""
    names = f"{'':10s}"
    axis = axis or ((17, "Time", "s") if kind == 1 else (18, "Frequency", "Hz"))
    return [
        *words,
        f"{kind:5d}{1:10d}{0:5d}{0:10d} {names}{node:10d}{direction:4d} {names}{reference[0]:10d}"
        f"{reference[1]:4d}",
        f"{type_:10d}{count:10d}{int(even):10d}{first:13.5E}{step:13.5E}{0.0:13.5E}",
        f"{axis[0]:10d}{0:5d}{0:5d}{0:5d} {axis[1]:20s} {axis[2]:20s}".rstrip(),
        f"{quantity:10d}{0:5d}{0:5d}{0:5d} {'Schwinggeschwindig.':20s} {unit:20s}".rstrip(),
        f"{reference_kind:10d}{0:5d}{0:5d}{0:5d} {'Kraft':20s} {reference_unit:20s}".rstrip(),
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}".rstrip(),
    ]


def _flat(values, abscissa, per_value):
    y = np.asarray(values)
    parts = [y.real, y.imag] if per_value == 2 else [y]
    return np.column_stack(([] if abscissa is None else [abscissa]) + parts)


def function(node, values, *, abscissa=None, type_=None, **more):
    """Data set 58 in text. With `abscissa` it is uneven."""
    type_ = type_ or (5 if np.iscomplexobj(values) else 2)
    lines = header(node, len(values), type_=type_, even=abscissa is None, **more)
    flat = _flat(values, abscissa, 1 + (type_ > 4))
    if type_ in (2, 5):
        fields = [f"{v:13.5E}" for v in flat.ravel()]
        rows = [fields[i : i + 6] for i in range(0, len(fields), 6)]
    elif abscissa is None:
        fields = [f"{v:20.12E}" for v in flat.ravel()]
        rows = [fields[i : i + 4] for i in range(0, len(fields), 4)]
    else:
        fields = [f"{r[0]:13.5E}" + "".join(f"{v:20.12E}" for v in r[1:]) for r in flat]
        width = 1 if type_ == 6 else 2
        rows = [fields[i : i + width] for i in range(0, len(fields), width)]
    return data_set(58, *lines, *map("".join, rows))


def binary(
    node,
    values,
    *,
    abscissa=None,
    type_=None,
    order="<",
    abscissa_bytes=4,
    claimed=None,
    before_mark=b"",
    **more,
):
    """Data set 58b. `claimed` is what its first line says of the number of bytes."""
    type_ = type_ or (5 if np.iscomplexobj(values) else 2)
    lines = header(node, len(values), type_=type_, even=abscissa is None, **more)
    y, x = ("f8" if type_ in (4, 6) else "f4"), f"f{abscissa_bytes}"
    flat = _flat(values, abscissa, 1 + (type_ > 4))
    kinds = ([] if abscissa is None else [order + x]) + [order + y] * (1 + (type_ > 4))
    records = np.empty(len(flat), [(f"c{i}", kind) for i, kind in enumerate(kinds)])
    for name, column in zip(records.dtype.names, flat.T, strict=True):
        records[name] = column
    raw = records.tobytes()
    n = len(raw) if claimed is None else claimed
    head = f"{58:6d}b{1 if order == '<' else 2:6d}{2:6d}{11:12d}{n:12d}{0:6d}{0:6d}{0:12d}{0:12d}\n"
    text = "".join(line + "\n" for line in lines)
    return MARK + (head + text).encode() + raw + before_mark + MARK


@pytest.fixture(scope="session")
def uff():
    """The functions above."""
    return SimpleNamespace(
        data_set=data_set,
        units=units,
        nodes=nodes,
        nodes_15=nodes_15,
        elements=elements,
        trace=trace,
        systems=systems,
        qualifiers=qualifiers,
        function=function,
        binary=binary,
        header=header,
        MARK=MARK,
    )
