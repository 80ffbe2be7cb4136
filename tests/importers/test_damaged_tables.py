"""A table that is damaged in one place is read equal, with points left out and counted, or refused.

Tables that the program writes itself have a check line: of those every damage is known. Of a table
of others nothing can be known where a number becomes another number, or the unit of all its values
another unit of motion; but a point number, coordinate, direction or frequency stands in several
rows or in several views, and whatever makes them disagree is known. So the bare tables are damaged
everywhere, and of their damages only these are not counted:

- a cell of a velocity or its error that was a number and still is one,
- two such cells of one row that are exchanged,
- the unit of a magnitude that was one of motion and still is one.

Coordinates of two views agree within a ten thousandth of the object's size.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.files import with_check_line
from sldvexp.importers import PointwiseView, conventions
from sldvexp.importers.scan_export import ScanExport
from sldvexp.importers.scan_table import NUMBER, is_motion
from sldvexp.importers.velocity_file import File
from sldvexp.io.registration import RegistrationTable, write
from sldvexp.io.registration import read as read_registration
from sldvexp.io.tables import write_table
from sldvexp.units import LengthUnit

SETTINGS = {
    "positive": conventions.Positive.towards,
    "phase": conventions.Phase.exp_plus,
    "amplitude": conventions.Amplitude.peak,
    "incomplete": "drop",
}
PLACES = 30.0 * np.array([[x, y, 0] for y in range(3) for x in range(4)])
RANDOM = np.random.default_rng(7)
PARTS = RANDOM.uniform(0.2, 3, (12, 2)) * RANDOM.choice([-1, 1], (12, 2))
VALUES = np.round(PARTS @ [1, 1j], 4)
#: Cells and labels that a slip of a hand or of a program may leave.
CELLS = ("", "nan", "x", "1e999", "12,5", "#", "=A1", "-", "0", "1.5.2", "NaN+i", "--", "µ")
UNITS = ("m", "mm", "cm", "in", "m/s", "mm/s", "mm/s^2", "g", "deg", "rad", "Hz", "V", "dB")
BYTES = np.frombuffer(b"0123456789.,;-+eE \t\n\r#\"'/[]()abmsxyzXR\x00\x80\xb5\xff", np.uint8)


@dataclass(frozen=True)
class Table:
    """A table, how it is read, and which of its columns hold what nothing else tells."""

    text: str
    read: object
    delimiter: str = "\t"
    alone: tuple[int, ...] = ()
    magnitude: int = -1
    checked: bool = False


def scan_text(names, columns):
    head = "Index\tX [mm]\tY [mm]\tZ [mm]\t" + "\t".join(names)
    rows = [
        "\t".join(
            [str(i), *(f"{c:g}" for c in PLACES[i - 1]), *(f"{c[i - 1]:.8g}" for c in columns)]
        )
        for i in range(1, 13)
    ]
    return "\n".join(["Source: plate.svd", "Frequency: 195 Hz", head, *rows]) + "\n"


REAL = scan_text(("Real [mm/s]", "Imag [mm/s]"), (VALUES.real, VALUES.imag))
POLAR = scan_text(
    ("Magnitude [mm/s]", "Phase [deg]"), (np.abs(VALUES), np.degrees(np.angle(VALUES)))
)
STANDS = {"a": [0.0, 0.0, 1.0], "b": [0.5, 0.0, 1.0]}


def read_scan(intact):
    def read(path):
        other = path.with_name("intact.txt")
        if not other.exists():
            other.write_text(intact, encoding="utf-8")
        views = {
            name: PointwiseView(path=str(own), origin=STANDS[name])
            for name, own in (("a", path), ("b", other))
        }
        group = ScanExport(views=views, **SETTINGS).read()
        found = dataset.take_findings({"line_of_sight": group})
        values = {
            (str(p), name): tuple(group[name].sel(point=p).values.ravel())
            for p in group["point"].values
            for name in ("velocity", "position", "direction_cosines")
        }
        return values | {"frequency": tuple(group["frequency"].values)}, found

    return read


def velocity_rows():
    rng = np.random.default_rng(8)
    for v, stand in enumerate(STANDS.values()):
        for p, place in enumerate(PLACES[:6] / 1000):
            line = (np.array(stand) - place) / np.linalg.norm(np.array(stand) - place)
            for f in (100, 200):
                z = rng.normal(size=2)
                yield [["front", "left"][v], f"p{p}", *place, *line.round(6), f, *z, 1e-6]


VELOCITY = ["view", "point", "x", "y", "z", "dx", "dy", "dz", "frequency", "real", "imag", "std"]


def read_velocities(path):
    group = File(path=str(path), incomplete="drop").read().sortby("frequency")
    found = dataset.take_findings({"line_of_sight": group})
    values = {
        (str(p), str(v)): tuple(
            np.concatenate(
                [
                    group[name].sel(point=p, view=v).values.ravel()
                    for name in ("velocity", "velocity_std", "direction_cosines")
                ]
            )
        )
        for p in group["point"].values
        for v in group["view"].values
    }
    places = {
        (str(p), "position"): tuple(group["position"].sel(point=p).values)
        for p in group["point"].values
    }
    return values | places | {"frequency": tuple(group["frequency"].values)}, found


def registration():
    rng = np.random.default_rng(9)
    angle = rng.uniform(-0.2, 0.2, (9, 2))
    return RegistrationTable(
        "front", np.arange(1, 10), rng.normal(size=(9, 3)), angle=angle, unit=LengthUnit.inch
    )


def read_points(path):
    (table,) = read_registration(path)
    rows = zip(table.number, table.object_point.tolist(), table.angle.tolist(), strict=True)
    return {int(n): (*point, *angle) for n, point, angle in rows}, []


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    folder = tmp_path_factory.mktemp("written")
    write_table(folder / "v.csv", VELOCITY, velocity_rows())
    velocities = (folder / "v.csv").read_text()
    bare = velocities.partition("\n")[2]
    found = {
        "real": Table(REAL, read_scan(REAL), alone=(4, 5)),
        "polar": Table(POLAR, read_scan(POLAR), alone=(4, 5), magnitude=4),
        "polar, checked": Table(with_check_line(POLAR), read_scan(POLAR), checked=True),
        "velocities": Table(bare, read_velocities, ",", (9, 10, 11)),
        "velocities, checked": Table(velocities, read_velocities, ",", checked=True),
    }
    for suffix in (".csv", ".reg"):
        write(folder / f"front{suffix}", [registration()])
        text = (folder / f"front{suffix}").read_text()
        found[f"registration {suffix}"] = Table(text, read_points, ",", checked=True)
    return found


def cells_of(line, table):
    return line.split(table.delimiter)


def damage(table, rng):
    """Damage a table in one place: what was done, and the bytes."""
    raw, lines = table.text.encode(), table.text.splitlines()
    kind = KINDS[rng.integers(len(KINDS))]
    at, row = int(rng.integers(len(raw))), int(rng.integers(len(lines)))
    byte = bytes([rng.choice(BYTES) if rng.random() < 0.8 else rng.integers(256)])
    cells = cells_of(lines[row], table)
    one, two = rng.integers(len(cells), size=2)
    if kind == "byte replaced":
        return kind, raw[:at] + byte + raw[at + 1 :]
    if kind == "byte inserted":
        return kind, raw[:at] + byte + raw[at:]
    if kind == "bytes deleted":
        return kind, raw[:at] + raw[at + int(rng.integers(1, 4)) :]
    if kind == "row deleted":
        del lines[row]
    elif kind == "row doubled":
        lines.insert(row, lines[row])
    elif kind == "rows exchanged":
        other = int(rng.integers(len(lines)))
        lines[row], lines[other] = lines[other], lines[row]
    elif kind == "row cut":
        lines[row] = lines[row][: int(rng.integers(len(lines[row]) + 1))]
    elif kind == "cells exchanged":
        cells[one], cells[two] = cells[two], cells[one]
    elif kind == "cell replaced":
        cells[one] = str(rng.choice(CELLS))
    elif kind == "cell of another place":
        cells[one] = str(rng.choice(cells_of(lines[int(rng.integers(len(lines)))], table)))
    elif kind == "unit replaced":
        places = list(re.finditer(r"(?<=\[)[^]]+(?=\])|(?<=_)(mm|m|inch|deg)\b", table.text))
        if not places:
            return "row deleted", "\n".join(lines[:row] + lines[row + 1 :]).encode() + b"\n"
        place = places[rng.integers(len(places))]
        unit = str(rng.choice(UNITS))
        return kind, (table.text[: place.start()] + unit + table.text[place.end() :]).encode()
    if kind in ("cells exchanged", "cell replaced", "cell of another place"):
        lines[row] = table.delimiter.join(cells)
    return kind, "\n".join(lines).encode() + b"\n"


KINDS = ("byte replaced", "byte inserted", "bytes deleted", "row deleted", "row doubled")
KINDS += ("rows exchanged", "row cut", "cells exchanged", "cell replaced", "cell of another place")
KINDS += ("unit replaced",)


def knowable(table, raw):
    """Whether something in the table, or between views, tells of the damage."""
    if table.checked:
        return True
    try:
        now = raw.decode("utf-8").rstrip("\n").split("\n")
    except UnicodeDecodeError:
        return True
    before = table.text.rstrip("\n").split("\n")
    if len(now) != len(before):
        return True
    changed = [
        (i, k, old, new)
        for i, (one, two) in enumerate(zip(before, now, strict=True))
        if len(cells_of(one, table)) == len(cells_of(two, table))
        for k, (old, new) in enumerate(zip(cells_of(one, table), cells_of(two, table), strict=True))
        if old != new
    ]
    if not changed or any(
        len(cells_of(one, table)) != len(cells_of(two, table))
        for one, two in zip(before, now, strict=True)
    ):
        return True
    for _, k, old, new in changed:
        number = (
            k in table.alone and NUMBER.fullmatch(old) and NUMBER.fullmatch(new.strip().strip(' "'))
        )
        unit = k == table.magnitude and "[" in old and is_motion(new.partition("[")[2].strip("] "))
        if not number and not unit:
            return True
    return False


def outcome(table, raw, path, right):
    """What becomes of a damaged table; `wrong` is what must not be."""
    path.write_bytes(raw)
    try:
        values, found = table.read(path)
    except UserError:
        return "refused"
    same = all(
        key in right and np.allclose(right[key], value, rtol=1e-9, atol=1e-15)
        for key, value in values.items()
    )
    if same and len(values) == len(right):
        return "equal"
    counted = any(f.size >= 1 for f in found)
    return "left out and counted" if same and counted else "wrong"


def tried(tables, path, count, seed):
    """Count outcomes of damages by kind of table."""
    rng = np.random.default_rng(seed)
    counts, wrong = Counter(), []
    paths = {name: path.with_suffix(".reg" if name.endswith(".reg") else ".csv") for name in tables}
    right = {}
    for name, table in tables.items():
        paths[name].write_text(table.text)
        right[name] = table.read(paths[name])[0]
    names = list(tables)
    while sum(counts.values()) - counts["not knowable"] < count:
        name = names[rng.integers(len(names))]
        kind, raw = damage(tables[name], rng)
        if not knowable(tables[name], raw):
            counts["not knowable"] += 1
            continue
        found = outcome(tables[name], raw, paths[name], right[name])
        counts[found] += 1
        if found == "wrong":
            wrong.append((name, kind, raw))
    return counts, wrong


def first_differences(tables, wrong):
    """Say where a damaged table differs, for a message."""
    for name, kind, raw in wrong[:5]:
        before, now = tables[name].text.split("\n"), raw.decode("utf-8", "replace").split("\n")
        differ = [pair for pair in zip(before, now, strict=False) if pair[0] != pair[1]]
        yield f"{name}, {kind}: {differ[0] if differ else (len(before), len(now))}"


@pytest.mark.parametrize("count", [100, pytest.param(250, marks=pytest.mark.whole)])
def test_damaged_tables(tables, tmp_path, count):
    counts, wrong = tried(tables, tmp_path / "front.csv", count, 14)
    assert not wrong, list(first_differences(tables, wrong))
    assert counts["refused"] > 0.6 * count  # most damages matter
    assert counts["equal"] > 0.04 * count
    assert counts["left out and counted"] > 0.012 * count


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_six_thousand_damaged_tables(tables, tmp_path, seed):
    counts, wrong = tried(tables, tmp_path / "front.csv", 1500, [14, seed])
    assert not wrong, list(first_differences(tables, wrong))
    assert sum(counts.values()) - counts["not knowable"] == 1500
