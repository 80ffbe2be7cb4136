"""Hostile files of measurements, objects and profiles, for every reader."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from operator import concat
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
from inputs import (
    CONF,
    Content,
    Hostile,
    fifo,
    folder,
    later,
    link,
    listening,
    sparse,
    sparse_after,
)
from inputs_configuration import LAUGHS

MESH = "~experiment scene=plate scan=rectangle instrument=simulated signal=sine_fit pose=given volume=mesh reconstruction=samplewise"
MESH += " 'scan.views={1: {corners: [[0, 0], [0, 9], [9, 9], [9, 0]]}}' scan.pixels=[2,2]"
MESH += " 'pose.views={1: {euler: [0.024, 2.910, -3.117], origin: [0.290, 0.530, 1.655]}}'"
PIXELS = "~experiment scene=plate instrument=simulated signal=sine_fit scan=list 'scan.views={1: {path: m.lst}}'"
POINTS = "~experiment reconstruction=absolute"
#: By the entrance and the file's ending: the command, and how a good file begins.
READERS: dict[str, tuple[str, str, bytes]] = {
    "REG": ("experiment=pose pose.path=m.reg", "m.reg", b"NUMREG 4\nUNITS inch\n"),
    "CSV": (
        "experiment=pose pose.path=m.csv",
        "m.csv",
        b"point,x_m,y_m,z_m,up_down_deg,left_right_deg\n1,0,0,0,1,1\n",
    ),
    "CSV of velocities": (
        "experiment=point instrument.path=m.csv",
        "m.csv",
        b"view,dx,dy,dz,frequency,real,imag,std\n1,0,0,1,100,1,2,0.1\n",
    ),
    "CSV of a digitizer": (
        "experiment=digitizer pose.path=m.csv",
        "m.csv",
        b"point,x_mm,y_mm,z_mm\n",
    ),
    "CSV of surface points": (
        f"{MESH.replace('mesh', 'points')} volume.path=m.csv",
        "m.csv",
        b"x_m,y_m,z_m\n0,0,0\n",
    ),
    "netCDF": ("experiment=pose pose.path=m.nc", "m.nc", b"\x89HDF\r\n\x1a\n"),
    "netCDF of velocities": ("experiment=point instrument.path=m.nc", "m.nc", b"CDF\x01"),
    "MAT": (
        "experiment=point instrument.path=m.mat",
        "m.mat",
        b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM",
    ),
    "UFF": (
        f"{POINTS} instrument=uff instrument.directions=view 'instrument.views={{a: {{path: m.uff, origin: [0, 0, 1]}}}}'",
        "m.uff",
        b"    -1\n    58\n",
    ),
    "text export": (
        f"{POINTS} instrument=scan_export 'instrument.views={{a: {{path: m.txt, origin: [0, 0, 1]}}}}'",
        "m.txt",
        b"Index;X [m];Y [m];Z [m];Magnitude [m/s];Phase [deg]\n",
    ),
    "mesh": (
        f"{MESH} volume.path=m.obj",
        "m.obj",
        b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n",
    ),
    "STL": (f"{MESH} volume.path=m.stl", "m.stl", b"solid x\n"),
    "pixels": (PIXELS, "m.lst", b"0 0\n1 1\n"),
    "pose": ("~experiment pose=given pose.path=m.txt", "m.txt", b"View: front\nphi1 = 1 +- 0.1\n"),
    "profile": (
        "~experiment scan=rectangle 'scan.views={1: {corners: [[0, 0], [0, 9], [9, 9], [9, 0]]}}' scan.pixels=[2,2] instrument=visa signal=sine_fit instrument.resource=TCPIP::127.0.0.1::9::SOCKET instrument.profile=m.yaml",
        "m.yaml",
        b"devices: {lab: {}}\n",
    ),
    "matrix": ("check m.yaml", "m.yaml", b"axes: {seed: [-1]}\n"),
}
NO_FILES: dict[str, tuple[Content, str]] = {
    "endless device": (link("/dev/zero"), ""),
    "pipe": (fifo, ""),
    "socket": (listening, ""),
    "link to itself": (link("itself"), ""),
    "folder": (folder, ""),
    "3 GB": (sparse, ""),
}
ALSO_WITHOUT_MORE = ("CSV of velocities", "matrix", "pixels")
CONTENTS: dict[str, bytes] = {
    "empty": b"",
    "zeros": b"\0" * 1000,
    "random": np.random.default_rng(3).bytes(5000),
    "one long line": b"1 " * 2**21,
    "one long word": b"x" * 2**22,
    "UTF-16": "a,b\n1,2\n".encode("utf-16"),
    "escape codes": b"\x1b]0;owned\x07\x1b[2J,\x1b[31m\n\x1b[8m,1\n",
    "lines of CR": b"1,2,3\r4,5,6\r",
    "quotes without end": b'"' * 4001,
}


def of_readers() -> Iterator[Hostile]:
    """Every reader with what is no file of its kind."""
    for entrance, (arguments, name, start) in READERS.items():
        own = dict(NO_FILES)
        own["3 GB after a good start"] = (sparse_after(start), "")
        if name == "itself":
            own.pop("link to itself")
        for what, (content, told) in own.items():
            made = link(name) if what == "link to itself" else content
            yield Hostile(entrance, what, arguments, {name: made}, told or name)
        for what, bytes_ in CONTENTS.items():
            yield Hostile(entrance, what, arguments, {name: bytes_}, name)
            good = entrance == "mesh" or (entrance in ALSO_WITHOUT_MORE and not bytes_)
            after = {name: later(partial(concat, start, bytes_))}
            about = f"{what} after a good start"
            told = "" if good else name
            yield Hostile(entrance, about, arguments, after, told, refused=not good)


def netcdf(make: Callable[[Any], object]) -> Callable[[Path], None]:
    """A file of HDF5 that the netCDF library opens."""

    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            make(file)

    return write


def claimed(file: Any) -> None:
    """Velocities of 8 TB."""
    file.create_dataset("velocity", (10**6, 10**6), "f8", chunks=(1000, 1000), fillvalue=1.0)
    file.create_dataset("direction_cosines", (10**6, 3), "f8", chunks=(1000, 3), fillvalue=1.0)


def packed(file: Any) -> None:
    """Zeros that are deflated a thousandfold."""
    file.create_dataset("velocity", data=np.zeros((4000, 4000)), compression="gzip")
    file.create_dataset("direction_cosines", data=np.zeros((4000, 3)), compression="gzip")


def points_of(file: Any) -> None:
    """Registration points that are in a circle, and claim a lot."""
    file["registration"] = file["/"]
    file.create_dataset("object_point", (10**9, 3), "f8", chunks=(1000, 3))


def mat(**arrays: Any) -> Callable[[Path], None]:
    """A MATLAB file."""
    return lambda path: scipy.io.savemat(path, arrays)


def mat_header(kind: int, size: int, shape: tuple[int, int]) -> bytes:
    """A MATLAB file whose one array has a header that claims what is not there."""
    flags = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, *shape)
    name = struct.pack("<IIQ", 1, 8, int.from_bytes(b"velocity", "little"))
    body = flags + name + struct.pack("<II", 9, size)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    return head + struct.pack("<II", kind, len(body) + size % 2**31) + body


def mat_bomb(path: Path) -> None:
    """Write a MATLAB file of 1 MB that unpacks to 1 GB."""
    packer, parts = zlib.compressobj(9), []
    parts.append(packer.compress(mat_header(14, 2**30, (2**27, 1))[128:]))
    parts += [packer.compress(bytes(2**24)) for _ in range(64)]
    body = b"".join([*parts, packer.flush()])
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    path.write_bytes(head + struct.pack("<II", 15, len(body)) + body)


def function(values: object, kind: int = 5, more: str = "") -> str:
    """A data set 58 with so many values."""
    lines = ["x"] * 5 + [
        "    4         1    0         1 NONE               1   3 NONE               1   3"
    ]
    lines.append(f"{kind:10}{values:>10}         1  0.00000e+00  1.00000e+00  0.00000e+00")
    lines += [
        "        18    0    0    0 Frequency            Hz",
        "        11    0    0    0 Velocity             m/s",
    ]
    lines += ["         0    0    0    0 NONE                 NONE"] * 2
    return "\n".join(
        ["    -1", "    58", *lines, more or "  1.00000e+00  1.00000e+00", "    -1", ""]
    )


def binary(values: int, count: int) -> str:
    """A data set 58b that claims values and bytes."""
    return function(values).replace(
        "    58\n",
        f"    58b     1     2          11{count:12}           0           0           0           0\n",
    )


POINT = "REGPOINT {0} {0} 0 {0} 1 1\n"
UFF, TEXT, PROFILE = (READERS[name][0] for name in ("UFF", "text export", "profile"))
VELOCITIES, POSE = "experiment=point instrument.path=m.", "experiment=pose pose.path=m."
CLAIMS: list[tuple[str, str, str, Content]] = [
    (
        "REG",
        "10^20 points",
        f"{POSE}reg",
        "NUMREG 100000000000000000000\nUNITS m\n" + POINT.format(1),
    ),
    ("REG", "10^17 points", f"{POSE}reg", "NUMREG 100000000000000000\nUNITS m\n" + POINT.format(1)),
    (
        "REG",
        "a point of 5000 digits",
        f"{POSE}reg",
        "NUMREG 1\nUNITS m\n" + POINT.format("9" * 5000),
    ),
    ("REG", "a point of 25 digits", f"{POSE}reg", "NUMREG 1\nUNITS m\n" + POINT.format("9" * 25)),
    (
        "REG",
        "400 000 points",
        f"{POSE}reg",
        later(lambda: "NUMREG 3\nUNITS m\n" + "".join(map(POINT.format, range(400_000)))),
    ),
    ("REG", "600 000 lines", f"{POSE}reg", "#\n" * 600_000),
    (
        "REG",
        "large powers",
        f"{POSE}reg",
        "NUMREG 3\nUNITS m\n" + "".join(f"REGPOINT {i} 1e{i}00 0 0 1 1\n" for i in (1, 2, 3)),
    ),
    (
        "CSV",
        "200 000 columns",
        f"{POSE}csv",
        later(lambda: ",".join(f"c{i}" for i in range(200_000)) + "\n1\n"),
    ),
    ("CSV", "a cell of 200 kB", f"{POSE}csv", "point,x_m\n1," + "9" * 200_000 + "\n"),
    (
        "CSV",
        "views without end",
        f"{VELOCITIES}csv",
        later(
            lambda: (
                "view,dx,dy,dz,frequency,real\n"
                + "".join(f"{i},0,0,1,{i},1\n" for i in range(60_000))
            )
        ),
    ),
    (
        "CSV",
        "large powers of velocities",
        f"{VELOCITIES}csv",
        "view,dx,dy,dz,real\n1,1e308,0,0,1e308\n2,0,1e308,0,1e308\n",
    ),
    ("netCDF", "8 TB", f"{VELOCITIES}nc", netcdf(claimed)),
    ("netCDF", "zeros, deflated", f"{VELOCITIES}nc", netcdf(packed)),
    ("netCDF", "a circle of points", f"{POSE}nc", netcdf(points_of)),
    (
        "netCDF",
        "random behind the signature",
        f"{POSE}nc",
        b"\x89HDF\r\n\x1a\n" + np.random.default_rng(1).bytes(4000),
    ),
    (
        "netCDF",
        "classic, 2^31 dimensions",
        f"{POSE}nc",
        b"CDF\x01\0\0\0\0\0\0\0\x0a\x7f\xff\xff\xff" + b"\0" * 100,
    ),
    (
        "netCDF",
        "classic, 8 TB",
        f"{VELOCITIES}nc",
        b"CDF\x05" + b"\0" * 8 + b"\0\0\0\x0a" + b"\x7f" * 8 + b"\0" * 200,
    ),
    ("MAT", "1 GB in 1 MB", f"{VELOCITIES}mat", mat_bomb),
    ("MAT", "8 TB", f"{VELOCITIES}mat", mat_header(14, 2**31 - 8, (2**31 - 1, 2**31 - 1))),
    ("MAT", "less than nothing", f"{VELOCITIES}mat", mat_header(14, 8, (-1, -5))),
    ("MAT", "texts", f"{VELOCITIES}mat", mat(velocity="x" * 1000, direction_cosines=["a", "b"])),
    (
        "MAT",
        "cells in cells",
        f"{VELOCITIES}mat",
        mat(
            velocity=np.array([[np.array([[1, 2]], object)]], object),
            direction_cosines=np.zeros((2, 3)),
        ),
    ),
    (
        "MAT",
        "ten dimensions",
        f"{VELOCITIES}mat",
        mat(velocity=np.zeros((1,) * 10), direction_cosines=np.zeros((2, 3))),
    ),
    ("UFF", "10^9 values", UFF, function(10**9)),
    ("UFF", "more digits than there are columns", UFF, function("9" * 40)),
    ("UFF", "fewer than no values", UFF, function(-5)),
    ("UFF", "10^9 binary values", UFF, binary(10**9, 8 * 10**9)),
    ("UFF", "more binary values than bytes", UFF, binary(100, 10**11)),
    ("UFF", "a mark in each line", UFF, "    -1\n" * 100_000),
    ("UFF", "100 000 data sets", UFF, "    -1\n   151\nx\n    -1\n" * 100_000),
    ("UFF", "no end", UFF, function(2).rsplit("    -1", 1)[0]),
    ("UFF", "blank lines", UFF, later(lambda: "\n" * 10_000_000)),
    ("text export", "numbers without end", TEXT, "1;" * 900_000 + "\n"),
    (
        "text export",
        "100 000 rows",
        TEXT,
        later(
            lambda: (
                "Index;X [m];Y [m];Z [m];V [m/s]\n"
                + "".join(f"{i};{i * 0.1};0;{i * 0.3};1\n" for i in range(100_000))
                + "x\n"
            )
        ),
    ),
    ("mesh", "faces of no nodes", READERS["mesh"][0], "v 0 0 0\nf 1 2 999999999999\n"),
    ("mesh", "faces before the first", READERS["mesh"][0], "v 0 0 0\nf -9 -8 -7\n"),
    ("mesh", "a face of 10 000", READERS["mesh"][0], "v 0 0 0\nf " + "1 " * 10_000 + "\n"),
    ("STL", "10^9 triangles", READERS["STL"][0], b"x" * 80 + struct.pack("<I", 10**9) + bytes(100)),
    ("pixels", "steps of 30 digits", READERS["pixels"][0], f"{'9' * 30} 0\n"),
    ("pixels", "steps of 5000 digits", READERS["pixels"][0], f"{'9' * 5000} 0\n"),
    ("profile", "laughs", PROFILE, LAUGHS),
    ("profile", "deep lists", PROFILE, "[" * 50_000),
    ("profile", "in itself", PROFILE, "a: &a {b: *a}\n"),
    (
        "profile",
        "a pattern without end",
        PROFILE,
        (CONF / "profile/virtual_lab.yaml").read_text().replace("identity: ", "identity: (a+)+$ #"),
    ),
    (
        "profile",
        "a pattern of 10^9",
        PROFILE,
        (CONF / "profile/virtual_lab.yaml")
        .read_text()
        .replace("identity: ", "identity: a{999999999999} #"),
    ),
    (
        "profile",
        "attributes in a command",
        PROFILE,
        (CONF / "profile/virtual_lab.yaml")
        .read_text()
        .replace("RATE {rate}", "RATE {rate.__class__.__mro__}"),
    ),
    (
        "profile",
        "widths of 10^9",
        PROFILE,
        (CONF / "profile/virtual_lab.yaml")
        .read_text()
        .replace("RATE {rate}", "RATE {rate:999999999}"),
    ),
    (
        "pose",
        "10^5 views",
        READERS["pose"][0],
        later(lambda: "".join(f"View: {i}\nphi1 = 1\n" for i in range(100_000))),
    ),
    ("pose", "large powers", READERS["pose"][0], "View: a\nphi1 = 1e999 +- 1e-999\n"),
]

INPUTS = [
    *of_readers(),
    *(
        Hostile(
            entrance,
            name,
            command,
            {
                READERS[entrance][1]
                if entrance in ("UFF", "text export", "mesh", "STL", "pixels", "profile", "pose")
                else command.split("=")[-1]: content
            },
            "",
        )
        for entrance, name, command, content in CLAIMS
    ),
]
