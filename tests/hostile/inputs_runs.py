"""Datasets of runs, run.nc, that somebody else has changed or made."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import netCDF4
import numpy as np
from inputs import Content, Hostile, fifo, link, sparse
from inputs_configuration import LAUGHS

READ_BY = {
    "report": "report given",
    "plot": "plot given",
    "export": "export given csv",
    "rerun": "rerun given",
    "compare": "compare given given",
    "pose": "~experiment pose=given pose.path=given/run.nc",
    "registration": "experiment=pose pose.path=given/run.nc",
    "velocities": "experiment=point instrument.path=given/run.nc",
}


def attribute(name: str, value: Any) -> Callable[[Path], None]:
    """Set an attribute of the root of a run's file."""

    def spoil(path: Path) -> None:
        with netCDF4.Dataset(path, "a") as file:
            file.setncattr(name, value)

    return spoil


def without(name: str) -> Callable[[Path], None]:
    """Take an attribute away."""

    def spoil(path: Path) -> None:
        with h5py.File(path, "a") as file:
            del file.attrs[name]

    return spoil


def changed(name: str, change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    """Change a table that the root of a run's file has as JSON."""

    def spoil(path: Path) -> None:
        with netCDF4.Dataset(path, "a") as file:
            table = json.loads(file.getncattr(name))
            file.setncattr(name, json.dumps(change(table)))

    return spoil


def with_config(text: str) -> Callable[[Path], None]:
    """Add lines to the configuration that a run's file has."""

    def spoil(path: Path) -> None:
        with netCDF4.Dataset(path, "a") as file:
            file.setncattr("config", file.getncattr("config") + text)

    return spoil


def hdf(change: Callable[[Any], object]) -> Callable[[Path], None]:
    """Change a file as HDF5."""

    def spoil(path: Path) -> None:
        with h5py.File(path, "a") as file:
            change(file)

    return spoil


def claims(file: Any) -> None:
    """A variable of 8 TB."""
    group = file[next(k for k in file if isinstance(file[k], h5py.Group))]
    group.create_dataset("claimed", (10**12,), "f8", chunks=(10**4,), fillvalue=0.0)


def deep(file: Any) -> None:
    """Groups in groups."""
    file.create_group("/".join("g" * 900))


def many(file: Any) -> None:
    """A great many groups."""
    for i in range(25_000):
        file.create_group(f"g{i}")


def circle(file: Any) -> None:
    """A group in itself."""
    file.create_group("circle")["again"] = file["/"]


def soft(file: Any) -> None:
    """A link to itself, and to nothing."""
    file["soft"] = h5py.SoftLink("/soft")
    file["none"] = h5py.SoftLink("/nothing")


def external(file: Any) -> None:
    """Links to other files."""
    file["external"] = h5py.ExternalLink("/etc/passwd", "/")
    file["own"] = h5py.ExternalLink("run.nc", "/")


def raw(file: Any) -> None:
    """An array whose bytes are those of another file."""
    group = file[next(k for k in file if isinstance(file[k], h5py.Group))]
    group.create_dataset("raw", (8,), "u1", external=[("/etc/passwd", 0, 8)])


def odd(file: Any) -> None:
    """Kinds of numbers that no result has."""
    group = file[next(k for k in file if isinstance(file[k], h5py.Group))]
    group.create_dataset("opaque", data=np.void(b"x" * 10))
    group.create_dataset("pair", data=np.zeros(3, [("a", "i4"), ("b", "f8")]))
    group.create_dataset("texts", data=["x" * 1000] * 10, dtype=h5py.string_dtype())
    group.create_dataset("reference", data=file.ref, dtype=h5py.ref_dtype)


def long_name(file: Any) -> None:
    """A name of 60 000 characters."""
    file.create_group("n" * 60_000)


def circle_of_two(file: Any) -> None:
    """Two groups in each other."""
    file.create_group("a/b")
    file["a/b/again"] = file["a"]


def claims_alone(file: Any) -> None:
    """An array of 8 TB."""
    file.create_dataset("seconds", (10**12,), "f8", chunks=(10**4,), fillvalue=0.0)


def written(make: Callable[[Any], object]) -> Callable[[Path], None]:
    """A new file of HDF5."""

    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            make(file)

    return write


def every(change: Callable[[Any], object]) -> Callable[[Path], None]:
    """Change every variable."""

    def spoil(path: Path) -> None:
        with netCDF4.Dataset(path, "a") as file:
            for group in file.groups.values():
                for variable in group.variables.values():
                    change(variable)

    return spoil


def swapped(path: Path) -> None:
    """Variables of other dimensions and kinds under the program's names."""
    with netCDF4.Dataset(path, "a") as file:
        for group in list(file.groups.values()):
            group.createDimension("odd", 2)
            for name in list(group.variables):
                group.renameVariable(name, f"{name}_")
                group.createVariable(name, "f4", ("odd",))[:] = 1


def bare(path: Path) -> None:
    """Groups with the program's names, and nothing in them."""
    with netCDF4.Dataset(path, "r") as file:
        about = {n: file.getncattr(n) for n in file.ncattrs()}
        names = list(file.groups)
    path.unlink()
    with netCDF4.Dataset(path, "w") as file:
        file.setncatts(about)
        for name in [*names, "pose", "field", "point", "check", "verdict", "registration", "image"]:
            if name not in file.groups:
                file.createGroup(name)


DAMAGES: dict[str, Callable[[Path], None] | bytes] = {
    "8 TB": hdf(claims),
    "deep groups": hdf(deep),
    "many groups": hdf(many),
    "a circle of groups": hdf(circle),
    "soft links": hdf(soft),
    "links to other files": hdf(external),
    "bytes of other files": hdf(raw),
    "odd kinds": hdf(odd),
    "a long name": hdf(long_name),
    "other shapes": swapped,
    "empty groups": bare,
    "times without end": every(lambda v: v.setncattr("units", "days since 99999-99-99")),
    "odd scales": every(lambda v: v.setncattr("scale_factor", "x")),
    "laughs": attribute("config", LAUGHS),
    "deep settings": attribute("config", "[" * 10_000),
    "settings of a megabyte": attribute("config", "a: " + "x" * 2**21),
    "code": with_config("_target_: os.abort\n"),
    "no settings": without("config"),
    "settings that are none": attribute("config", 3),
    "plugins that are none": attribute("plugins", "[" * 5000),
    "unknown plugins": attribute(
        "plugins", '{"pose": "os.abort", "instrument": ["x"], "laser": 3}'
    ),
    "inputs that are none": attribute("inputs_sha256", "[1]"),
    "packages that are none": attribute("packages", "3"),
    "no start": attribute("start_time", "x" * 10_000),
    "a verdict of others": attribute("verdict", "<script>alert(1)</script>"),
    "cut": b"",
    "3 GB": sparse,
    "a device": link("/dev/zero"),
    "a pipe": fifo,
}


def instead(content: Content) -> Callable[[Path], None]:
    """Something in place of a file that is there."""

    def make(path: Path) -> None:
        path.unlink(missing_ok=True)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())

    return make


def cut(path: Path) -> None:
    """The first half of a file."""
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


REPLACE = ("3 GB", "a device", "a pipe")
INPUTS = [
    Hostile(
        "run.nc",
        f"{damage} for {reader}",
        arguments,
        {"given/run.nc": cut if damage == "cut" else instead(how) if damage in REPLACE else how},
        "",
        refused=False,
        given="pose" if reader in ("pose", "registration") else "points",
    )
    for damage, how in DAMAGES.items()
    for reader, arguments in READ_BY.items()
]
SETTINGS = {
    "hydra": "hydra: {callbacks: {q: {_target_: os.abort}}}\n",
    "a resolver": "stream: ${oc.env:HOME}\n",
    "an unknown key": "evil: 1\n",
    "a plugin in a plugin": "check: {q: {plugin: os.abort}}\n",
    "a partial": "expect: {q: {at_most: {a: 1}, _partial_: true}}\n",
}
INPUTS += [
    Hostile(
        "run.nc",
        f"{name} for rerun",
        "rerun given",
        {"given/run.nc": with_config(text)},
        "",
        given="points",
    )
    for name, text in SETTINGS.items()
]
INPUTS += [
    Hostile(
        "run.nc",
        f"input {path} for rerun",
        "rerun given",
        {"given/run.nc": changed("inputs_sha256", lambda t, p=path: {p: "0"})},
        "",
        given="points",
    )
    for path in (
        "/dev/zero",
        "../../../../etc/passwd",
        "conf://../../../etc/passwd",
        "x\0y",
        "n" * 5000,
        "pipe",
    )
]
