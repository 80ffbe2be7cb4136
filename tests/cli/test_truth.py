"""`sldvexp truth`: a run beside what was true in the virtual lab."""

from __future__ import annotations

import re

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


@pytest.mark.whole
def test_a_shell_is_compared_on_the_face_and_on_the_middle_surface(sldvexp, run_once):
    """A bent plate's middle surface does not move along itself, its face does: both are said."""
    thin = ("volume.thickness=0.003", "volume.layers=3", "material=aluminium")
    found = run_once(*SMALL[:-1], *thin, "reconstruction=shell", "material.thickness=0.003")
    said = sldvexp("truth", str(found)).out
    face = said.partition("on the middle surface")[0]
    assert "on the measured face, which the beam meets:\nx at 197 Hz" in face
    true = {
        name: [float(v) for v in re.findall(rf"^{name} at .* true ([\d.e-]+) mm/s", said, re.M)]
        for name in "xz"
    }
    assert true["x"][0] > 0.01
    assert true["x"][1] != true["x"][0]  # its modes stretch it a little
    assert true["z"][0] == true["z"][1]
