"""Hostile folders of runs: their files, journals, links, and what Hydra left there."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import netCDF4
import numpy as np
from inputs import Content, Hostile, fifo, folder, link, sparse
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


def line_of(**arrays: Any) -> Callable[[Path], None]:
    """Put other arrays into the first kept scan line."""

    def spoil(path: Path) -> None:
        file = next(path.parent.rglob("*.npz"))
        with np.load(file) as kept:
            found = {k: kept[k] for k in kept.files}
        found.update(arrays)
        np.savez(file, **{k: v for k, v in found.items() if v is not None})

    return spoil


def first_line(content: Content) -> Callable[[Path], None]:
    """Put something else in place of the first kept scan line."""

    def spoil(path: Path) -> None:
        instead(content)(next(path.parent.rglob("*.npz")))

    return spoil


def bomb(path: Path) -> None:
    """An archive of 200 MB in 200 kB."""
    shape = b"{'descr': '<f8', 'fortran_order': False, 'shape': (25000000,), }".ljust(117)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
        for name in ("dac", "counts"):
            packed.writestr(
                f"{name}.npy", b"\x93NUMPY\x01\x00\x76\x00" + shape + b"\n" + bytes(10**8)
            )


def claiming(path: Path) -> None:
    """Arrays whose headers claim 8 TB."""
    with zipfile.ZipFile(path, "w") as packed:
        for name in ("dac", "asked", "counts", "volts_per_count", "rate", "status"):
            header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
            packed.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00\x76\x00" + header.ljust(117) + b"\n")


REPLAY = (
    "~experiment report=none scene=plate scan=rectangle instrument=replay instrument.path=given "
    "signal=sine_fit 'scan.views={1: {corners: [[0, 0], [0, 9], [9, 9], [9, 0]]}}' "
    "scan.pixels=[2,3] scan.sampling.samples=128"
)
LINES: dict[str, Callable[[Path], None]] = {
    "other shapes": line_of(counts=np.zeros((3, 5), np.int16)),
    "no numbers": line_of(dac=np.array([["a", "b"]] * 3)),
    "objects": line_of(asked=np.array([{"a": 1}], object)),
    "one pixel": line_of(status=np.zeros(1, np.uint8)),
    "nothing asked": line_of(asked=None),
    "no rate": line_of(rate=np.array([1.0, 2.0])),
    "NaN": line_of(rate=np.nan, volts_per_count=np.array([np.nan, np.inf])),
    "a bomb": first_line(bomb),
    "8 TB": first_line(claiming),
    "a pickle": first_line(b"\x80\x04cos\nabort\n)R."),
    "text": first_line("x"),
    "3 GB": first_line(sparse),
    "a device": first_line(link("/dev/zero")),
    "a pipe": first_line(fifo),
}
INPUTS += [
    Hostile(
        "journal",
        f"{name}, replayed",
        REPLAY,
        {"given/journal/1/x": spoil},
        "",
        refused=False,
        given="session",
    )
    for name, spoil in LINES.items()
]


def unfinished(spoil: Callable[[Path], None] | None = None) -> Callable[[Path], None]:
    """Take the results of a run away, and spoil something."""

    def make(path: Path) -> None:
        path.unlink()
        if spoil:
            spoil(path)

    return make


def resumed(
    name: str, told: str, *spoils: Callable[[Path], None], refused: bool = True, **more: Any
) -> Hostile:
    """A run that was cut off, whose folder somebody else has changed."""

    def make(path: Path) -> None:
        path.unlink()
        for spoil in spoils:
            spoil(path.parent)

    return Hostile(
        "run folder",
        name,
        "resume=given",
        {"given/run.nc": make},
        told,
        refused=refused,
        given="session",
        **more,
    )


def at(name: str, content: Content) -> Callable[[Path], None]:
    """Something else at a place of a run's folder."""

    def spoil(given: Path) -> None:
        import shutil

        file = given / name
        if file.is_dir() and not file.is_symlink():
            shutil.rmtree(file)
        file.parent.mkdir(parents=True, exist_ok=True)
        instead(content)(file)

    return spoil


def added(line: str) -> Callable[[Path], None]:
    """One more setting that Hydra is said to have recorded."""

    def spoil(given: Path) -> None:
        file = given / ".hydra/overrides.yaml"
        file.write_text(file.read_text() + f"- {json.dumps(line)}\n")

    return spoil


OUT = "../../beside/x"
FAR = "../../../beside/x"
INPUTS += [
    *(
        resumed(
            f"{name}, resumed", "", lambda given, s=spoil: s(given / "journal/1/x"), refused=False
        )
        for name, spoil in LINES.items()
    ),
    *(
        resumed(f"a link for {name}", "is a link", at(name, link(to)))
        for name, to in {
            ".hydra": "../../beside",
            ".hydra/config.yaml": FAR,
            ".hydra/hydra.yaml": FAR,
            ".lock": OUT,
            "sldvexp.log": OUT,
            "run.nc": OUT,
            "report.html": OUT,
            "journal/1": "../../../beside",
            "journal": "../../beside",
            "figures": "../../beside",
            "figures/pose.png": FAR,
            "pose.txt": OUT,
        }.items()
        if name != ".hydra" and name != ".hydra/hydra.yaml"
    ),
    resumed("no settings of Hydra's", "", at(".hydra", link("../../beside"))),
    resumed("a device for Hydra's", "", at(".hydra/overrides.yaml", link("/dev/zero"))),
    resumed("a pipe for Hydra's", "", at(".hydra/overrides.yaml", fifo)),
    resumed("laughs for Hydra's", "", at(".hydra/overrides.yaml", LAUGHS)),
    resumed("deep lists for Hydra's", "", at(".hydra/overrides.yaml", "[" * 10_000)),
    resumed("3 GB for Hydra's", "", at(".hydra/hydra.yaml", sparse)),
    resumed("a digest of 3 GB", "configuration.sha256", at("journal/configuration.sha256", sparse)),
    resumed(
        "a pipe for the digest", "configuration.sha256", at("journal/configuration.sha256", fifo)
    ),
    resumed(
        "a folder for the digest",
        "configuration.sha256",
        at("journal/configuration.sha256", folder),
    ),
    resumed(
        "bytes for the digest", "", at("journal/configuration.sha256", b"\xff" * 64), refused=False
    ),
    resumed("a file for the journal", "", at("journal", b"x")),
    resumed("a folder for the log", "", at("sldvexp.log", folder)),
    resumed("a folder for the results", "", at("run.nc", folder)),
    resumed("a folder for the lock", "", at(".lock", folder)),
    resumed("a pipe for the log", "", at("sldvexp.log", fifo)),
    resumed("a pipe for the lock", "", at(".lock", fifo), refused=False),
    *(
        resumed(f"recorded: {line[:40]}", "" if "resume" in line else "overrides.yaml", added(line))
        for line in (
            "+hydra.callbacks.x={_target_: os.abort}",
            "+hydra/callbacks=x",
            "hydra.run.dir=../../beside/x",
            "hydra.searchpath=[file://../../beside]",
            "+a@hydra.callbacks=x",
            "-m",
            "--config-dir=../../beside",
            "resume=../../beside",
            "seed=1,2",
            "seed=range(1,1000000000)",
            "seed=${oc.env:HOME}",
            "seed=" + "int(" * 1500 + "1" + ")" * 1500,
            "pose=" + "[" * 3000,
            "x" * 100_000 + "=1",
            "+check.q={plugin: truth, y: [{_partial_: true}]}",
        )
    ),
    Hostile(
        "run folder",
        "figures elsewhere",
        "plot given",
        {"given/figures": link("../../beside")},
        "is a link",
        given="points",
    ),
    Hostile(
        "run folder",
        "a figure elsewhere",
        "plot given point",
        {"given/figures/point.png": link(FAR)},
        "is a link",
        given="points",
    ),
    Hostile(
        "run folder",
        "a page elsewhere",
        "report given",
        {"given/report.html": link(OUT)},
        "",
        refused=False,
        given="points",
    ),
    Hostile(
        "run folder",
        "an export elsewhere",
        "export given csv",
        {"given/velocity.csv": link(OUT)},
        "",
        refused=False,
        given="points",
    ),
    Hostile(
        "run folder",
        "figures are a pipe",
        "plot given",
        {"given/figures": fifo},
        "figures",
        given="points",
    ),
    Hostile(
        "run folder",
        "a page that is a folder",
        "report given",
        {"given/report.html": folder},
        "report.html",
        given="points",
    ),
    *(
        Hostile(
            "run folder",
            f"links in a sweep: {name}",
            "-m ~experiment target=dissertation report=none seed=1,2 hydra.sweep.dir=swept",
            {f"swept/{name}": link(to)},
            "is a link",
        )
        for name, to in {
            ".lock": OUT,
            ".sweep.json": OUT,
            "seed=1": "../../beside",
            "sweep.nc": OUT,
        }.items()
    ),
    Hostile(
        "run folder",
        "a sweep of others",
        "-m ~experiment target=dissertation report=none seed=1 hydra.sweep.dir=swept",
        {"swept/.sweep.json": "[" * 100_000},
        "",
        refused=False,
    ),
    Hostile(
        "run folder",
        "a sweep of a device",
        "-m ~experiment target=dissertation report=none seed=1 hydra.sweep.dir=swept",
        {"swept/seed=1/record.json": fifo},
        "",
        refused=False,
    ),
    Hostile(
        "run folder",
        "no sweep",
        "report given/sweep.nc",
        {"given/sweep.nc": b"x"},
        "sweep.nc",
        given="points",
    ),
    Hostile(
        "run folder",
        "a sweep that is a run",
        "report given/sweep.nc",
        {"given/sweep.nc": lambda p: p.write_bytes((p.parent / "run.nc").read_bytes())},
        "sweep.nc",
        given="points",
    ),
]
INPUTS += [
    Hostile(
        "run folder",
        f"{name} for Hydra's, rerun",
        "rerun given",
        {"given/.hydra/hydra.yaml": instead(content)},
        "",
        refused=False,
        given="points",
    )
    for name, content in {
        "a pipe": fifo,
        "a device": link("/dev/zero"),
        "laughs": LAUGHS,
        "deep lists": "[" * 10_000,
        "another place": "hydra: {runtime: {cwd: /dev/zero}}\n",
        "a folder": folder,
    }.items()
]
SWEPT = "-m ~experiment target=dissertation report=none seed=1 hydra.sweep.dir=swept"
RECORD = '{"state": "done", "identity": "x", "inputs": {"INPUT": "0"}}'
INPUTS += [
    Hostile(
        "run folder",
        f"a sweep that read {name[:20]}",
        SWEPT,
        {"swept/seed=1/record.json": RECORD.replace("INPUT", name)},
        "",
        refused=False,
    )
    for name in ("/dev/zero", "/proc/self/mem", "../../../etc/passwd", "n" * 5000, "\\u0000")
]
INPUTS += [
    Hostile(
        "run folder",
        f"a table of a sweep, {name}",
        "report swept",
        {"swept/sweep.nc": make},
        "swept/sweep.nc",
    )
    for name, make in {
        "in a circle": written(circle_of_two),
        "of 8 TB": written(claims_alone),
        "of no keys": written(lambda file: file.create_dataset("seconds", data=1.0)),
        "that is a pipe": fifo,
        "that is 3 GB": sparse,
    }.items()
    if name != "that is a pipe"
]
