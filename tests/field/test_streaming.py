"""Fields of more frequencies than fit into memory: as in memory, on threads and clusters."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.field.bounds.intercept_test import NOTHING
from sldvexp.laser import Mirror, TwoMirror, project
from sldvexp.pose import pose_to_dataset

pytest.importorskip("dask")
psutil = pytest.importorskip("psutil")  # comes with distributed

LASER = TwoMirror(mirror_offset=0.045, up_down=Mirror(25), left_right=Mirror(25))
STANDS = [[0.0, -0.5, 1.6], [0.6, 0.5, 1.5], [-0.5, 0.4, 1.5], [0.6, -0.2, 1.5], [-0.3, -0.1, 1.7]]
#: What a pose is known to, rad and m.
POSE_STD = [2e-5] * 3 + [5e-5] * 3
NOISE = 1e-5


def towards(origin: np.ndarray) -> np.ndarray:
    """World to laser, the beam's rest position through the world's origin."""
    z = -origin / np.linalg.norm(origin)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def write_images(
    path: Path,
    shape: tuple[int, int],
    frequencies: int,
    each: bool,
    modes: int = 4,
    noisy: bool = True,
    lines: int | None = None,
) -> None:
    """Five views of a plate in one file, some frequencies at a time.

    Parameters
    ----------
    path : Path
    shape : pair of int
        Pixels of each view.
    frequencies : int
    each : bool
        Whether pixels have a standard error at each frequency.
    modes : int
        Of the plate.
    noisy : bool
        Without noise the standard errors are the same.
    lines : int, optional
        Write the first frequencies only.
    """
    rng, of_noise, step = np.random.default_rng(5), np.random.default_rng(6), 32
    origins = np.array(STANDS)
    poses = pose_to_dataset(
        [str(k + 1) for k in range(5)],
        [towards(o) for o in origins],
        origins,
        np.broadcast_to(np.diag(np.square(POSE_STD)), (5, 6, 6)),
        np.full(5, 100.0),
        0.95,
    )
    dataset.save({"pose": poses}, {}, path)
    x, y = np.meshgrid(*(np.linspace(-0.19, 0.19, n) for n in shape), indexing="ij")
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    amplitude = rng.normal(size=(modes, frequencies)) + 1j * rng.normal(size=(modes, frequencies))
    amplitude = amplitude[:, :lines]
    pixels, frequencies = len(points), amplitude.shape[1]
    with netCDF4.Dataset(path, "a", auto_complex=True) as file:
        for k, origin in enumerate(origins):
            group = file.createGroup(f"image/{k + 1}")
            group.createDimension("pixel", pixels)
            group.createDimension("frequency", frequencies)
            group.createDimension("mirror", 2)
            group.setncattr("shape", list(shape))
            group.createVariable("frequency", "f8", ("frequency",))[:] = 50.0 + np.arange(
                frequencies
            )
            in_laser = (points - origin) @ towards(origin).T
            dac = LASER.dac_from_angle(project(in_laser, LASER.mirror_offset))
            group.createVariable("dac", "f8", ("pixel", "mirror"))[:] = dac
            flags = np.zeros(pixels, np.int8)
            flags[rng.choice(pixels, pixels // 200, replace=False)] = 2
            group.createVariable("flags", "i1", ("pixel",))[:] = flags
            dims = ("pixel", "frequency") if each else ("pixel",)
            std = group.createVariable("velocity_std", "f8", dims)
            std.units = "m/s"
            level = NOISE * (1 + np.arange(frequencies) / frequencies) if each else NOISE
            std[:] = np.broadcast_to(level, (pixels, frequencies) if each else (pixels,))
            velocity = group.createVariable(
                "velocity",
                np.complex64,
                ("pixel", "frequency"),
                chunksizes=(pixels, min(step, frequencies)),
            )
            velocity.units = "m/s"
            to_instrument = origin - points
            to_instrument /= np.linalg.norm(to_instrument, axis=1)[:, None]
            u = np.stack([mode(points, m) for m in range(modes)], axis=1)
            along = np.einsum("pmi,pi->pm", u, to_instrument)
            for first in range(0, frequencies, step):
                some = slice(first, first + step)
                values = along @ amplitude[:, some]
                if noisy:
                    values += NOISE * (of_noise.normal(size=(*values.shape, 2)) @ [1, 1j])
                values[flags != 0] = np.nan
                velocity[:, some] = values.astype(np.complex64)


def mode(points: np.ndarray, m: int) -> np.ndarray:
    """Velocity of a mode, shape (point, 3), m/s."""
    x, y = points[:, 0], points[:, 1]
    bending = np.sin((3 + m) * x + m) * np.cos((4 - m) * y)
    return 0.01 * np.stack([0.1 * x * y, 0.05 * np.sin(5 * x + m), bending], axis=1)


def arguments(path: Path, shape: Sequence[int], layers: int, *more: str) -> list[str]:
    """Of the command."""
    return [
        "~experiment",
        "instrument=images",
        f"instrument.path={path}",
        "pose=given",
        f"pose.path={path}",
        "laser.mirror_offset=0.045",
        "laser.up_down={gain: 25.0, unit: deg}",
        "laser.left_right={gain: 25.0, unit: deg}",
        "volume=grid",
        "volume.size=[0.3,0.3]",
        "volume.center=[0.0,0.0,0.0]",
        f"volume.shape=[{shape[0]},{shape[1]}]",
        f"volume.layers={layers}",
        "volume.thickness=0.004",
        "report=none",
        *more,
    ]


def assert_same(a: xr.Dataset, b: xr.Dataset, tolerance: float, attributes: bool = True) -> None:
    """Groups with the same variables and, but for rounding, values."""
    assert set(a.variables) == set(b.variables)
    for name, variable in a.variables.items():
        assert variable.dims == b[name].dims
        if variable.dtype.kind in "fc":
            scale = np.nanmax(np.abs(variable.values), initial=0.0)
            # F is a distance in a covariance whose condition number may be 1 / NOTHING; the
            # logarithm of its probability follows it.
            near = np.finfo(float).eps / NOTHING if str(name).startswith("f_") else tolerance
            if name == "f_p_value":
                sure = variable.values > 0
                near *= np.nanmax(-np.log(variable.values[sure]), initial=1.0)
            least = near * scale
            if name == "interpolation_error":  # differences of velocities, and rounded as these
                least += np.finfo(float).eps * np.nanmax(np.abs(a["velocity"].values))
            np.testing.assert_allclose(
                b[name].values,
                variable.values,
                rtol=near,
                atol=least,
                err_msg=name,
            )
        else:
            np.testing.assert_array_equal(b[name].values, variable.values)
    assert set(a.attrs) == set(b.attrs)
    for name, value in a.attrs.items() if attributes else ():
        if isinstance(value, float):
            assert b.attrs[name] == pytest.approx(value, rel=tolerance, nan_ok=True), name
        else:
            np.testing.assert_array_equal(b.attrs[name], value)


@pytest.mark.parametrize(
    ("each", "method"),
    [
        pytest.param(True, ["reconstruction=contravariant"], marks=pytest.mark.whole),
        pytest.param(
            False,
            ["reconstruction=absolute", "reconstruction.model=full"],
            marks=pytest.mark.long,
        ),
    ],
    ids=["contravariant", "full"],
)
def test_the_same_as_in_memory(
    sldvexp: Callable[..., Any], tmp_path: Path, each: bool, method: list[str]
) -> None:
    """Every variable and attribute, to rounding; blocks and images do not stay."""
    path = tmp_path / "images.nc"
    write_images(path, (24, 22), 8, each)
    called = arguments(path, (8, 7), 3, *method)
    whole = sldvexp(*called)
    assert whole.status == 0, whole.err
    streamed = sldvexp(*called, "stream=dask", "stream.frequencies=3", "stream.pixels=100")
    assert streamed.status == 0, streamed.err
    field, blocks = (run.tree["field"].to_dataset() for run in (whole, streamed))
    assert field["velocity_std_pose"].min() > 0
    # Bounds come from an inverse, which is known to its condition number's rounding.
    assert_same(field, blocks, max(1e-12, np.finfo(float).eps * field.attrs["cond"]))
    assert "image" not in streamed.tree.children
    assert sorted(p.name for p in streamed.folder.iterdir() if p.name.startswith(".b")) == []


@pytest.mark.whole
@pytest.mark.parametrize("each", [True, False])
def test_surfaces_the_same_as_in_memory(
    sldvexp: Callable[..., Any], tmp_path: Path, each: bool
) -> None:
    """Field and strain of a shell, to rounding; lines whose noise differs, and alike ones."""
    path = tmp_path / "images.nc"
    write_images(path, (24, 22), 20, each)
    shell = ["reconstruction=shell", "material=aluminium", "material.thickness=0.003"]
    called = arguments(path, (8, 7), 5, *shell)
    whole = sldvexp(*called)
    assert whole.status == 0, whole.err
    streamed = sldvexp(*called, "stream=dask", "stream.frequencies=6", "stream.pixels=100")
    assert streamed.status == 0, streamed.err
    assert whole.tree["field"]["velocity_std_pose"].values.min() > 0
    for name in ("field", "strain"):
        found, blocks = (run.tree[name].to_dataset() for run in (whole, streamed))
        assert_same(found, blocks, 1e-8)
    assert sorted(p.name for p in streamed.folder.iterdir() if p.name.startswith(".b")) == []


@pytest.mark.whole
def test_mistakes_are_found_and_repaired_as_in_memory(
    sldvexp: Callable[..., Any], tmp_path: Path
) -> None:
    """A wrong sign and bad pixels: the same verdict, flags and field, before a repair and after."""
    path, bad = tmp_path / "images.nc", [100, 250, 300]
    write_images(path, (24, 22), 20, True)
    with netCDF4.Dataset(path, "a", auto_complex=True) as file:
        file["image/4/velocity"][:] = -file["image/4/velocity"][:]
        values = file["image/2/velocity"][:]
        values[bad] += 0.02
        file["image/2/velocity"][:] = values
    called = arguments(path, (8, 7), 3, "reconstruction=contravariant")
    streams = ["stream=dask", "stream.frequencies=6", "stream.pixels=100"]
    for repair, verdict in (("[]", "void"), ("[view_4.sign]", "trusted")):
        whole = sldvexp(*called, f"use_repair={repair}")
        assert whole.status == 0, whole.err
        streamed = sldvexp(*called, *streams, f"use_repair={repair}")
        assert streamed.status == 0, streamed.err
        assert whole.tree.attrs["verdict"] == streamed.tree.attrs["verdict"] == verdict
        assert "use_repair=[view_4.sign]" in streamed.out or repair != "[]"
        told, same = (run.tree["verdict"].to_dataset() for run in (whole, streamed))
        assert told["text"].values.tolist() == same["text"].values.tolist()
        field, blocks = (run.tree["field"].to_dataset() for run in (whole, streamed))
        assert_same(field, blocks, max(1e-12, np.finfo(float).eps * field.attrs["cond"]))
        # The images stay in their file; what they were changed to does not get lost.
        assert "image" not in streamed.tree.children
        flags = streamed.tree["flagged/2"]["flags"]
        assert (flags.values[bad] == 32).all()
        np.testing.assert_array_equal(flags.values, whole.tree["image/2"]["flags"].values)
    assert streamed.tree["flagged/4"].attrs["repaired"] == "view_4.sign"


@pytest.mark.whole
def test_view_that_is_left_out_has_no_part_in_the_blocks(
    sldvexp: Callable[..., Any], tmp_path: Path
) -> None:
    """A view of another field is left out as asked, and the others are as in memory."""
    path = tmp_path / "images.nc"
    write_images(path, (24, 22), 20, False)
    with netCDF4.Dataset(path, "a", auto_complex=True) as file:
        file["image/2/velocity"][:] = file["image/2/velocity"][::-1]
        file["image/2/flags"][:] = file["image/2/flags"][::-1]
    called = arguments(path, (8, 7), 3, "reconstruction=contravariant")
    called.append("use_repair=[view_2.left_out]")
    whole = sldvexp(*called)
    assert whole.status == 0, whole.err
    streamed = sldvexp(*called, "stream=dask", "stream.frequencies=6", "stream.pixels=100")
    assert streamed.status == 0, streamed.err
    field, blocks = (run.tree["field"].to_dataset() for run in (whole, streamed))
    assert_same(field, blocks, max(1e-12, np.finfo(float).eps * field.attrs["cond"]))


@pytest.mark.long
def test_replayed_session(sldvexp: Callable[..., Any]) -> None:
    """Raw samples view by view, images in files in between: the same run as in memory."""
    called = [
        "experiment=plate_frf",
        "scan.pixels=[9,9]",
        "scan.sampling.frequency=[195.0,440.0,545.0,785.0,840.0]",
        "volume.shape=[5,4]",
        *("reconstruction=samplewise", "~compare.samplewise", "~check.truth", "~check.samplewise"),
        *("~expect.truth", "~expect.resonances", "~expect.all_lines"),
        "report=none",
    ]
    whole = sldvexp(*called)
    assert whole.status == 0, whole.err
    again = ["instrument=replay", f"instrument.path={whole.folder}"]
    streamed = sldvexp(*called, *again, "stream=dask", "stream.frequencies=2", "stream.pixels=20")
    assert streamed.status == 0, streamed.err
    for group in ("image/1", "field"):
        a, b = (run.tree[group].to_dataset() for run in (whole, streamed))
        assert_same(a, b, 1e-12 if group == "field" else 0.0)


@pytest.mark.whole
def test_what_is_refused(sldvexp: Callable[..., Any], tmp_path: Path) -> None:
    """One sentence each."""
    path = tmp_path / "images.nc"
    write_images(path, (12, 11), 3, False)
    with netCDF4.Dataset(path, "a") as file:
        file["image/3/frequency"][:] = 1.0
    called = arguments(path, (4, 3), 2, "reconstruction=absolute", "stream=dask")
    assert "view 3: its frequencies" in sldvexp(*called).err
    assert "stream.frequencies must be 1 or more" in sldvexp(*called, "stream.frequencies=0").err
    one_way = ("stream.workers=2", "stream.scheduler=tcp://127.0.0.1:1")
    assert "stream.workers must be 0 if scheduler is given" in sldvexp(*called, *one_way).err
    right = tmp_path / "right.nc"  # the other may still be open
    write_images(right, (12, 11), 3, False)
    called = arguments(right, (4, 3), 2, "reconstruction=absolute", "stream=dask")
    none = sldvexp(*called, "stream.scheduler=127.0.0.1:1:2")
    assert "stream: there is no scheduler" in none.err


def test_without_the_package(
    sldvexp: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The sentence says what to install."""
    path = tmp_path / "images.nc"
    write_images(path, (12, 11), 3, False)
    monkeypatch.setitem(sys.modules, "dask.array", None)
    run = sldvexp(*arguments(path, (4, 3), 2, "reconstruction=absolute", "stream=dask"))
    assert run.status == 1
    assert "pip install 'sldvexp[dask]'" in run.err


#: Of the images that are larger than the memory that is allowed.
PIXELS, LINES, SHAPE = (400, 250), 512, (25, 21)
GIGABYTE = 1_000_000  # kB
COMMAND = """
import sys
from sldvexp.cli.main import main
try:
    main()
finally:
    print(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images of 2 GB."""
    path = tmp_path_factory.mktemp("large") / "images.nc"
    write_images(path, PIXELS, LINES, False, modes=6)
    assert path.stat().st_size > 2e9
    return path


def start(images: Path, folder: Path, *more: str) -> subprocess.Popen[str]:
    """The command in a process of its own, which says its peak memory at the end."""
    called = arguments(images, SHAPE, 3, "reconstruction=contravariant", *more)
    command = [sys.executable, "-c", COMMAND, *called, f"hydra.run.dir={folder}"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def field_of(folder: Path) -> xr.Dataset:
    with dataset.load(folder / "run.nc") as tree:
        return tree["field"].to_dataset().load()


def first_lines(images: Path, path: Path, lines: int) -> None:
    """The first lines of all images, as a file of their own."""
    with dataset.load(images) as tree:
        groups = {name.strip("/"): node.to_dataset(inherit=False) for name, node in _leaves(tree)}
        some = {k: g.isel(frequency=slice(lines), missing_dims="ignore") for k, g in groups.items()}
        dataset.save({k: g.load().drop_encoding() for k, g in some.items()}, {}, path)


def _leaves(tree: xr.DataTree) -> list[tuple[str, xr.DataTree]]:
    return [(node.path, node) for node in tree.subtree if node.has_data]


@pytest.fixture(scope="module")
def streamed(large: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """The folder of a run in one process, and its peak memory in kB."""
    folder = tmp_path_factory.mktemp("streamed") / "run"
    process = start(large, folder, "stream=dask")
    said, _ = process.communicate()
    assert process.returncode == 0, said
    return folder, int(said.split("VmHWM:")[1].split()[0])


@pytest.mark.long
def test_more_than_memory(large: Path, streamed: tuple[Path, int], tmp_path: Path) -> None:
    """2 GB of images take less than 1 GB; the first lines are those of a run in memory.

    How a pose moves velocities is told by many lines better than by few of the same noise: their
    bounds are nearly those without any noise.
    """
    folder, peak = streamed
    assert peak <= GIGABYTE
    first_lines(large, tmp_path / "some.nc", 8)
    process = start(tmp_path / "some.nc", tmp_path / "run")
    assert process.wait() == 0
    whole, some = field_of(folder), field_of(tmp_path / "run")
    assert whole.sizes["frequency"] == LINES
    same = ["velocity", "velocity_std_noise", "element_error", "sse", "chi2_ratio", "efficiency"]
    begin = whole[same].isel(frequency=slice(8))
    assert_same(begin, some[same], 1e-11, attributes=False)
    write_images(tmp_path / "quiet.nc", PIXELS, LINES, False, modes=6, noisy=False, lines=8)
    process = start(tmp_path / "quiet.nc", tmp_path / "quiet")
    assert process.wait() == 0
    quiet = field_of(tmp_path / "quiet")
    first = whole.isel(frequency=slice(8))
    ratio = first["velocity_std"] / quiet["velocity_std"]
    np.testing.assert_allclose(ratio, 1.0, atol=0.05)
    of_pose = first["velocity_std_pose"] / quiet["velocity_std_pose"]
    assert float(np.abs(of_pose.median() - 1)) < 0.001
    few = some["velocity_std"] / quiet["velocity_std"]
    assert float((ratio - 1).std()) < float((few - 1).std())


@pytest.mark.long
def test_killed_worker(large: Path, streamed: tuple[Path, int], tmp_path: Path) -> None:
    """Of two workers one dies in the middle of the blocks: nothing is lost."""
    folder = tmp_path / "run"
    process = start(large, folder, "stream=dask", "stream.workers=2")
    peaks: dict[int, int] = {}
    killed = 0
    while process.poll() is None:
        workers = _workers(process.pid)
        peaks |= {pid: peak for pid, peak in workers.items() if peak}
        if not killed and len(list(folder.glob(".blocks.*/*/*.nc"))) >= 6 and workers:
            killed = next(iter(workers))
            os.kill(killed, signal.SIGKILL)
        time.sleep(0.1)
    said = process.stdout.read() if process.stdout else ""
    assert process.returncode == 0, said
    assert killed
    assert len(peaks) >= 3  # another one took its place
    assert max(*peaks.values(), int(said.split("VmHWM:")[1].split()[0])) <= GIGABYTE
    assert_same(field_of(streamed[0]), field_of(folder), 1e-11)


def _workers(pid: int) -> dict[int, int]:
    """Worker processes of a run and their peak memory so far, kB."""
    found = {}
    try:
        for child in psutil.Process(pid).children(recursive=True):
            if "spawn_main" in " ".join(child.cmdline()):
                status = Path(f"/proc/{child.pid}/status").read_text()
                found[child.pid] = int(status.partition("VmHWM:")[2].split()[0])
    except (psutil.Error, OSError, IndexError):
        return {}
    return found
