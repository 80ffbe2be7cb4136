"""Folders of runs and of sweeps, and scan lines kept in them, as somebody else left them."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from inputs import Content, Hostile, fifo, folder, link, sparse
from inputs_configuration import LAUGHS
from inputs_runs import circle_of_two, claims_alone, instead, written


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
INPUTS = [
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
        "sweep.nc",
    )
    for name, make in {
        "in a circle": written(circle_of_two),
        "of 8 TB": written(claims_alone),
        "of no keys": written(lambda file: file.create_dataset("seconds", data=1.0)),
        "that is a pipe": fifo,
        "that is 3 GB": sparse,
    }.items()
]
