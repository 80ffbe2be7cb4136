"""`sldvexp truth`: a run beside what was true in the virtual lab."""

from __future__ import annotations

import re

import numpy as np
import pytest

from sldvexp.virtual_lab.console import main

SMALL = (
    "report=none",
    *(f"~scan.{part}.views.{view}" for part in ("calibration", "structure") for view in "45"),
    "scan.structure.pixels=[9,11]",
    "volume.shape=[7,6]",
    "volume.layers=3",
)


@pytest.fixture(scope="module")
def whole(run_once):
    return run_once(*SMALL)


@pytest.mark.whole
def test_poses_and_field_are_compared_with_the_scene(sldvexp, whole):
    done = sldvexp("truth", str(whole))
    assert (done.status, done.err) == (0, "")
    views = re.findall(r"^view (\d): its pose is ([\d.]+) mm \(standard error", done.out, re.M)
    assert [name for name, _ in views] == ["1", "2", "3"]
    assert all(float(away) < 10.0 for _, away in views)
    face, middle = done.out.split("on the middle surface", 1)
    assert "\nz at 197 Hz" in middle
    off = re.findall(r"^([xyz]) at 197 Hz: .* off the true .* mm/s, ([\d.]+)%;", face, re.M)
    assert [name for name, _ in off] == ["x", "y", "z"]
    assert float(off[2][1]) < 5.0
    assert sldvexp("truth", str(whole), "scene=plate").out == done.out


@pytest.mark.whole
@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "command line: truth takes the folder of one run, and scene=name"),
        (["none"], "none: there is no such file; a run's dataset is called run.nc"),
        (["RUN", "laser=ometron"], "command line: laser: truth takes settings of scene alone; "),
        (["RUN", "scene=plat"], "command line: there is no scene=plat; did you mean plate?"),
    ],
)
def test_what_has_no_truth_is_told_in_one_sentence(sldvexp, whole, words, told):
    done = sldvexp("truth", *(word.replace("RUN", str(whole)) for word in words))
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith(f"sldvexp: {told}"), done.err
    assert done.err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--port", "99999"], "--port must be from 0 to 65535, not 99999; 0 takes a free one"),
        (["--port", "abc"], "command line: argument --port: invalid int value: 'abc'; "),
        (["--prot=1"], "command line: unrecognized arguments: --prot=1; sldvexp-lab --help"),
        (["--host", "x.invalid", "scene=plate"], "--host x.invalid: there is no address of this"),
    ],
)
def test_the_lab_tells_a_wrong_option_in_one_sentence(monkeypatch, capsys, words, told):
    monkeypatch.setattr("sys.argv", ["sldvexp-lab", *words])
    with pytest.raises(SystemExit, match="1"):
        main()
    said = capsys.readouterr().err
    assert said.startswith(f"sldvexp-lab: {told}"), said
    assert said.count("\n") == 1


#: Sides and thickness of the scene's plate, m.
SIDES, THICKNESS = np.array([0.3, 0.25]), 0.003


@pytest.mark.whole
def test_a_shell_is_compared_on_the_face_and_on_the_middle_surface(sldvexp):
    """Where a thin plate w only bends its face moves along itself by h dw/dx, its middle not."""
    thin = ("volume.thickness=0.003", "volume.layers=3", "material=aluminium", "expect={}")
    bent = ("~scene.plate.modes.stretch_x", "~scene.plate.modes.stretch_y")
    done = sldvexp(*SMALL[:-1], *thin, *bent, "reconstruction=shell", "material.thickness=0.003")
    (found,) = (line for line in done.out.splitlines() if line.startswith("found: "))
    assert found.startswith("found: velocity on the measured face at 197 Hz: x 0.3")
    assert "; on the middle surface: x not above its bound" in found
    said = sldvexp("truth", str(done.folder)).out
    assert "on the measured face, which the beam meets:\nx at 197 Hz" in said
    for part, bends in zip(said.split("on the middle surface"), (1, 0), strict=True):
        lines = re.findall(r"^([xyz]) at .* true ([\d.e-]+) mm/s(, [\d.]+%)?;", part, re.M)
        assert [(name, bool(share)) for name, _, share in lines] == [
            ("x", bool(bends)),
            ("y", bool(bends)),
            ("z", True),
        ]
        true = np.array([float(size) for _, size, _ in lines])
        assert true == pytest.approx(first_mode(done.tree["field"]) * [bends, bends, 1], rel=0.01)


def first_mode(field):
    """Compute what the face moves in the first mode, r.m.s. over the nodes, mm/s."""
    middle = field["position"].values[np.abs(field["position"].values[:, 2]) < 1e-9, :2]
    phase = np.pi * ((middle - [0.42, 0.14]) / SIDES + 0.5)
    (sin_x, sin_y), (cos_x, cos_y) = np.sin(phase).T, np.cos(phase).T
    slope = THICKNESS / 2 * np.pi / SIDES
    shape = np.stack([slope[0] * cos_x * sin_y, slope[1] * sin_x * cos_y, sin_x * sin_y])
    return 20.0 * np.sqrt(np.mean(shape**2, axis=1))
