"""Bad inputs, each through the real command: exit status 1, one sentence, nothing left behind.

A sentence says what is wrong, where, and what would be right.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import xarray as xr

CONF = Path(__file__).parents[2] / "conf"
REG = (CONF / "data/figure_4_28.reg").read_text()
REG_LINES = REG.splitlines()
DIGITISED = (CONF / "data/digitizer_example.csv").read_text()
VIEWS = """view,dx,dy,dz,frequency,real,imag,std
1,0,0,1,100,1,2,0.1
2,0.8,0,0.6,100,1,2,0.1
3,0,0.6,0.8,100,1,2,0.1
4,0.6,0,0.8,100,1,2,0.1
"""
TABLE = """point,x_m,y_m,z_m,up_down_deg,left_right_deg
1,0,0,0,1,1
2,0.3,0,0,1,-1
3,0.3,0.3,0,-1,-1
4,0,0.3,0,-1,1
"""
EXPERIMENT = """# @package _global_
defaults:
  - override /pose: registration
  - _self_
pose:
  path: conf://data/figure_4_28.reg
"""
OBJECT = "~experiment target=dissertation"
KNOWN = "{euler: [0, 0, 0], origin: [0, 0, 1]}"
REFUSED = "is refused: a configuration names plugins and cannot name code"


Content = str | bytes | Callable[[Path], object]


@dataclass
class Bad:
    """A command line, what it must be answered (`…` stands for any text), and its files."""

    arguments: str
    answer: str
    files: dict[str, Content] = field(default_factory=dict)


def on_pose(arguments: str, answer: str) -> Bad:
    return Bad(f"experiment=pose {arguments}", f"command line: {answer}")


def on_reg(answer: str, *changes: tuple[str, str], more: str = "") -> Bad:
    text = REG
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return Bad(f"experiment=pose pose.path=m.reg {more}", answer, {"m.reg": text})


def on_views(answer: str, old: str = "", new: str = "", more: str = "") -> Bad:
    assert old in VIEWS
    arguments = f"experiment=point instrument.path=m.csv {more}"
    return Bad(arguments, answer, {"m.csv": VIEWS.replace(old, new)})


def on_file(name: str, content: Content, answer: str) -> Bad:
    key = "instrument" if name.endswith(("mat", "nc", "dat")) else "pose"
    experiment = "point" if key == "instrument" else "pose"
    return Bad(f"experiment={experiment} {key}.path={name}", answer, {name: content})


def on_experiment(added: str, answer: str) -> Bad:
    return in_folder("experiment=x", f"experiment/x.yaml{answer}", experiment_x=EXPERIMENT + added)


def in_folder(arguments: str, answer: str, **files: Content) -> Bad:
    """With a --config-dir; `experiment_x` is the name of my/experiment/x.yaml."""
    content = {f"my/{n.replace('_', '/', 1)}.yaml": text for n, text in files.items()}
    return Bad(f"--config-dir my {arguments}", f"my/{answer}", content)


def on_target(setting: str, answer: str) -> Bad:
    return Bad(f"{OBJECT} '{setting}'", f"command line: {answer}")


def on_given(views: str, answer: str) -> Bad:
    arguments = f"~experiment pose=given 'pose.views={{front: {views}}}'"
    return Bad(arguments, answer)


def on_averages(arguments: str, answer: str) -> Bad:
    return Bad(f"experiment=plate_broadband scan.pixels=[2,3] {arguments}", answer)


AVERAGES = [
    on_averages(
        "signal=sine_fit",
        "scan.sampling.excitation=multisine needs signal=response, which averages records",
    ),
    on_averages(
        "scan.sampling.excitation=sweep",
        "command line: …sweep…Valid: …chirp…",
    ),
    on_averages(
        "scan.sampling.band=[51,54]",
        "…scan.sampling.band has no line of a record of 0.2 s, whose lines are 5 Hz apart…",
    ),
    on_averages(
        "scan.sampling.excitation=hammer scan.sampling.trigger=free",
        "…scan.sampling.trigger must be generator, for a record of hammer that starts at any…",
    ),
    on_averages(
        "scene.digitizer.reference_gain=0 scene.vibrometer.drop_out=0",
        "scan: in the image of the view 1 6 of 6 pixels are flagged (reference_missing 6): the "
        "reference channel has no signal; the generator's output is off, its cable is not plugged "
        "in, or triggers were missed; put it right, then delete …",
    ),
    on_averages(
        "scan.sampling.amplitude=8",
        "scan: …6 of 6 pixels are flagged (saturated 6): records are over range; choose a larger "
        "range or a smaller amplitude; put it right, then delete …",
    ),
]
CHOICES = [
    Bad("target=nope", "command line: there is no target=nope; Valid: …dissertation…"),
    Bad("laser=ometrn", "command line: there is no laser=ometrn; did you mean ometron? Valid: …"),
    Bad("instrument=nope", "command line: there is no instrument=nope; Valid: …file…"),
    Bad(
        "pose=registratio",
        "command line: there is no pose=registratio; did you mean registration?…",
    ),
    Bad(
        "reconstruction=absolut",
        "command line: there is no reconstruction=absolut; did you mean absolute? Valid: …",
    ),
    Bad(
        "experiment=dissertation/registrasion",
        "command line: there is no experiment=dissertation/registrasion; did you mean "
        "dissertation/registration? Valid: …",
    ),
    Bad(
        "check=bitangents",
        "command line: check=bitangents must be a table; a plugin is added to it by a "
        "name of yours, as in check.mine.plugin=name; Valid: bitangents…",
    ),
    on_pose(
        "check.mine.plugin=bitangent",
        "check.mine.plugin: there is no check=bitangent; did you mean bitangents? Valid: …",
    ),
    on_pose(
        "compare.mine.plugin=absolut",
        "compare.mine.plugin: there is no reconstruction=absolut; did you mean absolute? Valid: …",
    ),
    on_pose(
        "laser=null",
        "laser=null must name a choice, and ~laser leaves the group out; Valid: ometron…",
    ),
    on_pose("lasr=ometron", "lasr is not a known setting; did you mean laser? Valid: …"),
    Bad(
        "~experiment pose.path=a.reg",
        "command line: pose.path belongs to no plugin; choose one with pose=...; Valid: "
        "…registration…",
    ),
    Bad(
        "~experiment", "there is nothing to do: choose an experiment, for example experiment=pose…"
    ),
    Bad(
        "~laser experiment=pose",
        "…the pose needs the instrument's mirrors: choose one with laser=name",
    ),
    Bad(
        "~experiment pose=registration",
        "…pose.path must name a registration file, or one for each view as {front: "
        "a.reg, left: b.reg}, unless scan=by_hand or scan=by_digitizer gives the points",
    ),
    Bad(
        "--config-name nope",
        "command line: there is no configuration nope; is --config-name right?",
    ),
    Bad("--config-dir nope", "command line: there is no folder nope"),
    Bad(
        "--config-path . experiment=pose",
        "command line: --config-path would replace the program's own configuration; add "
        "a folder of yours with --config-dir",
    ),
    Bad(
        "--nope",
        "command line: unrecognized arguments: --nope; sldvexp --hydra-help lists the options",
    ),
]

KEYS = [
    on_pose("sed=1", "sed is not a known setting; did you mean seed? Valid: …"),
    on_pose(
        "pose.max_iteration=9",
        "pose.max_iteration is not a known setting; did you mean max_iterations? Valid: "
        "adjust, confidence, inverted, max_iterations, path, refine, shared, unit",
    ),
    on_pose(
        "laser.up_down.gian=25",
        "laser.up_down.gian is not a known setting; did you mean gain? Valid: gain, gain_std, "
        "polynomial, polynomial_std, unit, zero, zero_std",
    ),
    on_pose(
        "expect.residuals.tolerence=1",
        "expect.residuals.tolerence is not a known setting; did you mean tolerance? Valid: …",
    ),
    on_pose("+foo=1", "foo is not a known setting; Valid: check, …"),
    on_pose("+pose.foo=1", "pose.foo is not a known setting; Valid: adjust, …"),
    on_pose("++laser.up_down.foo=1", "laser.up_down.foo is not a known setting; Valid: gain, …"),
    on_pose(
        "pose.adjust.unknown=1", "pose.adjust.unknown cannot be adjusted; Valid: gain_left_right, …"
    ),
    on_pose("~seed", "seed cannot be deleted"),
    on_experiment(
        "  max_iteration: 9\n",
        ": pose.max_iteration is not a known setting; did you mean max_iterations? Valid: …",
    ),
    on_experiment(
        "laser: {up_down: {gian: 3}}\n",
        ": laser.up_down.gian is not a known setting; did you mean gain? Valid: …",
    ),
    on_experiment(
        "expect: {q: {at_mst: {pose/sse: 1}}}\n",
        ": expect.q.at_mst is not a known setting; did you mean at_most? Valid: …",
    ),
    in_folder(
        "experiment=pose pose=mine",
        "pose/mine.yaml: pose.max_iteration is not a known setting; did you mean "
        "max_iterations? Valid: …",
        pose_mine="defaults: [schema/registration@_here_, _self_]\nmax_iteration: 3\n",
    ),
    Bad(
        "experiment=point instrument=uff instrument.path=a.uff",
        "command line: instrument=uff does not go with conf/experiment/point.yaml, which sets "
        "instrument.path for a choice of its own; begin with '~experiment' instrument=uff instead "
        "and add what else is needed, or choose it in a copy of that file",
    ),
    in_folder(
        "~experiment pose=mine",
        "pose/mine.yaml: pose has settings but no plugin; choose one with …",
        pose_mine="path: a.reg\n",
    ),
]

VALUES = [
    on_pose("pose.adjust=[1]", "pose.adjust must be a table, as in {name: value}"),
    on_pose("laser.mirror_offset=abc", "laser.mirror_offset must be a number, not abc"),
    on_pose(
        "laser.mirror_offset=nan", "laser.mirror_offset must be zero or a positive number, not nan"
    ),
    on_pose("pose.max_iterations=1.5", "pose.max_iterations must be a whole number, not 1.5"),
    on_pose("seed=-1", "seed must be zero or a positive integer, not -1"),
    on_pose("seed=???", "seed must be given"),
    on_pose("pose.confidence=1.5", "pose.confidence must lie between 0 and 1, not 1.5"),
    on_pose(
        "'pose.adjust={mirror_offset: .inf}'",
        "pose.adjust.mirror_offset must be a number; infinity is written inf here",
    ),
    on_pose("pose.inverted=up_down", "pose.inverted must be a list, as in [a, b]"),
    on_pose(
        "laser.board=bits_13",
        "laser.board cannot be bits_13; did you mean bits_16? Valid: bits_12_sign, bits_16",
    ),
    on_pose(
        "laser.up_down=5",
        "laser.up_down must be a table of the settings gain, zero, polynomial, unit, "
        "gain_std, zero_std, polynomial_std, as "
        "in {name: value}",
    ),
    on_pose(
        "pose.path=",
        "pose.path must name a registration file, or one for each view as {front: a.reg, "
        "left: b.reg}",
    ),
    on_pose("'pose.path=${nope}'", "pose.path refers to ${nope}, but there is no nope"),
    on_pose(
        "'pose.path=${nope:1}'", "pose.path refers to ${nope:...}, but there is no resolver nope"
    ),
    on_pose(
        "=3",
        "'=3' cannot be read; write key=value, and put a value with special characters "
        "into quotes of its own",
    ),
    on_pose("'a b'", "'a b' cannot be read; write key=value, …"),
    on_pose(
        "seed=1,2",
        "seed=1,2 has several values; -m runs each of them, [a, b] is a list, and quotes "
        "make a text",
    ),
    on_experiment("seed: abc\n", ": seed must be a whole number, not abc"),
    in_folder(
        "experiment=outer",
        "experiment/x.yaml: pose.max_iterations must be at least 1, not 0",
        experiment_x=EXPERIMENT + "  max_iterations: 0\n",
        experiment_outer="# @package _global_\ndefaults: [x, _self_]\nseed: 3\n",
    ),
    in_folder(
        "experiment=pose laser=mine",
        "laser/mine.yaml: laser.up_down.gain must not be zero: the mirror would not move",
        laser_mine="defaults: [ometron, _self_]\nup_down: {gain: 0}\n",
    ),
]

TARGETS = [
    Bad(
        "experiment=plate plan.noise=40",
        "command line: plan.noise is 40 m/s, more than vibrometers measure at all: is plan.unit "
        "right?",
    ),
    Bad(
        "experiment=plate scene.vibrometer.noise=40",
        "command line: scene.vibrometer.noise is a part of full_scale, below 1, not 40.0: 0.005 "
        "is the usual 0.5 %",
    ),
    on_target(
        "target.circles={1: {diameter: -1}}",
        "target.circles.1.diameter must be a positive number, not -1.0",
    ),
    on_target(
        "target.circles={1: {diameter: 0}}",
        "target.circles.1.diameter must be a positive number, not 0.0",
    ),
    on_target(
        "target.circles={2: {x: 2.5, y: 2.9}}",
        "target.circles: circles 1 and 2 overlap: their centers are 0.254954 inch apart, "
        "which must be more than the sum of their radii",
    ),
    on_target(
        "target.circles={2: {x: 2.26, y: 2.82, diameter: 0.1}}",
        "target.circles: circles 1 and 2 lie one inside the other: their centers are …",
    ),
    on_target(
        "target.circles={1: {plane: frnt}}",
        "target.circles.1.plane: there is no plane frnt; did you mean front? Valid: front",
    ),
    on_target(
        "target.circles.1.diameter=-1",
        "target.circles.1.diameter cannot be reached by dots; write 'target.circles={1: "
        "{diameter: -1}}'",
    ),
    on_target(
        "target.planes.raised.normal=[1, 0]",
        "target.planes.raised.normal cannot be reached by dots; write "
        "'target.planes={raised: {normal: [1, 0]}}'",
    ),
    on_target("target.pairs=[1-9]", "target.pairs[0]: 1-9 names circle 9; there are 1, 2, 3, 4"),
    on_target(
        "target.pairs=[1-2, 2-1]",
        "target.pairs[1]: 2-1 is listed twice; its points would be counted twice",
    ),
    Bad(
        "~experiment target=fiducials 'target.fiducials={1: {x: nan}}'",
        "command line: target.fiducials.1 must be finite, not nan",
    ),
]

REGISTRATIONS = [
    Bad("experiment=pose pose.path=m.reg", "m.reg: there is no such file (looked from {here})"),
    on_file(
        "m.reg", b"\x00\xff\xfe" * 50, "m.reg: is not a text file, although its suffix says so"
    ),
    on_file(
        "m.reg",
        "\n".join(REG_LINES[:10]),
        "m.reg: NUMREG promises 16 points but 7 REGPOINT lines follow (point 8 is missing)",
    ),
    on_reg(
        "m.reg, line 2: unknown unit 'furlong'; Valid: cm, ft, inch, m, mm",
        ("UNITS inch", "UNITS furlong"),
    ),
    on_reg(
        "m.reg, line 8: x of point 5 must be finite, not nan",
        ("REGPOINT 5 7.0696", "REGPOINT 5 nan"),
    ),
    on_reg(
        "m.reg, line 8: x of point 5 must be finite, not inf",
        ("REGPOINT 5 7.0696", "REGPOINT 5 inf"),
    ),
    on_reg(
        "m.reg, line 8: point number 4 stands on line 7 already", ("REGPOINT 5 ", "REGPOINT 4 ")
    ),
    on_reg(
        "m.reg, line 8: up_down of point 5 must be below 90 deg, not 120 (are these DAC steps?)",
        ("7.6883e+00", "120"),
    ),
    on_reg(
        "m.reg: point 1 of view m: the up_down angle of 5.724 deg is not within the "
        "mirror's range of -5 to 5 deg; …",
        more="laser.up_down.gain=5",
    ),
    on_file(
        "m.reg",
        "\n".join(["NUMREG 2", *REG_LINES[1:5]]),
        "m.reg, view m: a pose needs at least 3 points, not 2",
    ),
    on_file(
        "m.reg",
        "NUMREG 3\nUNITS m\n" + "".join(f"REGPOINT {i} {i} 0 0 {i} 0\n" for i in "123"),
        "m.reg, view m: the object points lie on one line: a pose needs points that span a plane",
    ),
    on_file(
        "m.csv",
        TABLE.replace(",z_m", "").replace("0,1,", "1,"),
        "m.csv: the column z_m is missing; …",
    ),
    on_file(
        "m.csv",
        TABLE.replace("2,0.3", "2,nan"),
        "m.csv, line 3: x_m of point 2 must be finite, not nan",
    ),
    on_file(
        "m.csv",
        TABLE.replace("_deg", "_dac").replace("2,0.3,0,0,1", "2,0.3,0,0,5000"),
        "m.csv: point 2 of view m: the up_down DAC step 5000 is not within the mirror's "
        "range of -4096 to 4096; …",
    ),
]

VELOCITIES = [
    Bad(
        "~experiment reconstruction=absolute",
        "…there are no velocities to reconstruct from; name a file with instrument=file "
        "instrument.path=..., or choose a volume and scan images of the structure",
    ),
    on_views(
        "m.csv, line 3: imag must be a finite number, not 'inf'", "0.6,100,1,2", "0.6,100,1,inf"
    ),
    on_views(
        "…the row 'abc' is no view (a name, or a number from 1 to 4) and no difference of two; "
        "Valid: 1, 2, 3, 4",
        more="reconstruction.rows=abc",
    ),
    on_file(
        "m.nc",
        lambda path: xr.Dataset({"velocity": ("view", [1.0])}).to_netcdf(path, engine="netcdf4"),
        "m.nc: the variable direction_cosines is missing; needed are direction_cosines, velocity",
    ),
    Bad(
        "experiment=point instrument.path=m.csv",
        "m.csv: there is no such file (looked from {here})",
    ),
    Bad("experiment=point instrument.path=.", ".: is a folder; a file is needed"),
    on_file("m.nc", b"junk", "m.nc: is not a readable netCDF-4 file…"),
    on_file("m.mat", b"junk" * 50, "m.mat: is not a readable MATLAB file"),
    on_file(
        "m.mat",
        b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(384) + b"\x89HDF\r\n\x1a\n",
        "m.mat: is not a readable MATLAB 7.3 file",
    ),
    on_views(
        "m.csv: the column dz is missing; needed are view, dx, dy, dz, real",
        "dz,frequency",
        "point,frequency",
    ),
    on_views(
        "m.csv, line 3: real must be a finite number, not 'nan'; leave points without a velocity "
        "out with instrument.incomplete=drop, or keep them marked with instrument.incomplete=mark",
        "0.6,100,1",
        "0.6,100,nan",
    ),
    on_views(
        "m.csv, line 3: std must be a positive number, not '-0.1'",
        "0.6,100,1,2,0.1",
        "0.6,100,1,2,-0.1",
    ),
    on_views("m.csv, line 3: has 9 values under 8 columns", "0.6,100", "0.6,7,100"),
    on_views(
        "m.csv: the length of the direction of view 2 is 1.28062, but must be 1: …",
        "2,0.8,0,0.6",
        "2,0.8,0,1",
    ),
    on_views("m.csv, line 3: view 1, frequency 100 is given twice", "\n2,", "\n1,"),
    on_views(
        "m.csv: there is no row for view 1, frequency 200 and 3 others; leave points without a "
        "velocity out with instrument.incomplete=drop, or keep them marked with "
        "instrument.incomplete=mark",
        "0.6,100",
        "0.6,200",
    ),
    on_views(
        "…the row '9' is no view (a name, or a number from 1 to 4) and no difference of "
        "two; Valid: 1, 2, 3, 4",
        more="reconstruction.rows=9",
    ),
    on_views(
        "…the row 1-1 subtracts a view from itself; name two views", more="reconstruction.rows=1-1"
    ),
    on_views(
        "…the rows 1,1 contain 1 twice; each row may stand there once",
        more="""'reconstruction.rows="1,1"'""",
    ),
    on_views(
        "…at least 4 rows are needed, but there are 3: 1,2,3",
        VIEWS[VIEWS.index("4,0.6") :],
        "",
        "reconstruction.model=full",
    ),
    on_views(
        "…the best 3 rows are asked for, but 2 views do not have 3 independent rows of "
        "this method; more views are needed",
        VIEWS[VIEWS.index("3,0,") :],
        "",
        "reconstruction=contravariant",
    ),
    on_views(
        "command line: reconstruction.model must be partial for relative: an intercept "
        "cancels in every difference",
        more="reconstruction=relative reconstruction.model=full",
    ),
]


def on_rough_pose(setting: str, answer: str) -> Bad:
    return Bad(f"~experiment target=dissertation instrument=simulated {setting}", answer)


ROUGH_POSES = [
    on_rough_pose(
        "scan=calibration scan.views.front.pose.origin=[0,0,1]",
        "command line: scan.views.front.pose.origin cannot be reached by dots; write "
        "'scan.views={front: {pose: {origin: [0,0,1]}}}'",
    ),
    on_rough_pose(
        "scan=calibration 'scan.views={front: {pose: {origin: [0, 0, 1]}}}'",
        "command line: scan.views.front.pose: give either euler or look_at, and the origin",
    ),
    on_rough_pose(
        "scan=calibration 'scan.views={front: {dac: [[1, 2]], pose: {origin: [0, 0, 1], "
        "look_at: [0, 0, 0]}}}'",
        "command line: scan.views.front: give dac, path, or a rough pose, one of them",
    ),
    on_rough_pose(
        "scan=session 'scan.poses={front: {origin: [0, 0], look_at: [0, 0, 0]}}'",
        "command line: scan.poses.front.origin must be three numbers, not 2",
    ),
    on_rough_pose(
        "scan=rectangle scan.stride=9 'scan.views={front: {pose: {origin: [0, 0, 1], "
        "look_at: [0, 0, 0]}}}' 'scan.corners_at=[[0, 0, 0], [1, 0], [1, 1, 0]]'",
        "command line: scan.corners_at[1] must be three numbers x, y, z, not [1, 0]",
    ),
    on_rough_pose(
        "scan=session scene=calibration signal=sine_fit "
        "'scan.poses={\"1\": {origin: [0.1, 0.1, 0.2], look_at: [0.1, 0.1, 0]}}'",
        "scan: in the view 1, circle 3 is out of reach: the up_down angle of …",
    ),
]

OTHER_POSES = [
    on_given(
        "{euler: [0, 0], origin: [0, 0, 1]}",
        "command line: pose.views.front.euler must be three numbers, not 2",
    ),
    on_given(
        "{looks_at: [0, 0, 0], origin: [0, 0, 1]}",
        "command line: pose.views.front.looks_at is not a known setting; did you mean look_at? …",
    ),
    on_given(
        "{look_at: [0, 0, 0], origin: [0, 0, 1], roll: level}",
        "command line: pose.views.front.roll must be a number, not level",
    ),
    Bad(
        "~experiment pose=given pose.path=a.txt",
        "a.txt, line 2: phi1 must be a number, not 'abc'",
        {"a.txt": "View: a\nphi1 = abc\n"},
    ),
    Bad(
        "experiment=digitizer 'pose.instrument_points={low: [0, 0, 0], med: [1, 0, 0], "
        "high: [2, 0, 0]}'",
        "command line: pose.instrument_points: the points lie on one line; the rotation "
        "about it is unknown",
    ),
    Bad(
        "experiment=digitizer pose.path=m.csv",
        "m.csv: every point must be digitised equally often, but there is low 7 times, "
        "…, upper_left 6 times",
        {"m.csv": "\n".join(DIGITISED.splitlines()[:-1])},
    ),
    Bad(
        "experiment=digitizer pose.path=m.sev",
        "m.sev: repeat 1 of the instrument_points lies on one line; digitise it again",
        {"m.sev": "1 2 3\n" * 14},
    ),
]

EXPECTATIONS = [
    on_pose(
        "'expect.x={at_most: {pose/see: 1}}'",
        "expect.x: pose/see: pose has no variable see; did you mean sse? Valid: …",
    ),
    on_pose(
        "'expect.x={at_most: {pose/sse: abc}}'",
        "expect.x.at_most.pose/sse must be a number, not abc",
    ),
    on_pose(
        "'expect.x={published: {pose/origin: [1, 2]}}'",
        "expect.x: pose/origin: published has 2 numbers, but the run has 3",
    ),
    on_pose(
        "'expect.x={published: {pose/origin: [1, 2, abc]}}'",
        "expect.x: pose/origin: published must be numbers, not 'abc'",
    ),
    on_pose(
        "'expect.x={at_most: {pose/sse: 1}, tolerance: -1}'",
        "expect.x.tolerance must be zero or a positive number, not -1.0",
    ),
    on_pose(
        "'expect.x={at_most: {examined/tru/error: 1}}'",
        "expect.x: names examined/tru/error, but check has no entry tru; Valid: …; ~expect.x …",
    ),
    Bad(
        "'check.t={plugin: truth, of: other}'",
        "command line: check.t.of is other, but compare has no entry other; Valid: …; ~check.t …",
    ),
    on_experiment(
        "expect: {q: {at_most: {pose/see: 1}}}\n",
        ": expect.q: pose/see: pose has no variable see; did you mean sse? Valid: …",
    ),
    Bad(
        f"{OBJECT} check.e.plugin=pose_repeats",
        "…check=pose_repeats needs a pose from points: choose pose=registration, or leave the "
        "check out with '~check.pose_repeats'",
    ),
    Bad(
        f"{OBJECT} 'check.e={{plugin: pose_equivalence, views: {{a: {KNOWN}}}}}'",
        "…check=pose_equivalence needs a pose to compare: choose pose=...",
    ),
    on_given(
        f"{KNOWN}}}' 'check.e={{plugin: bitangents",
        "…check=bitangents needs a calibration object: choose a target",
    ),
]

CODE = [
    on_experiment("  _target_: os.system\n", f": pose._target_ {REFUSED}"),
    on_experiment("expect: {q: {_target_: os.system}}\n", f": expect.q._target_ {REFUSED}"),
    on_experiment("_target_: os.system\n", f": _target_ {REFUSED}"),
    on_experiment(
        "check: {q: {plugin: printed, _target_: os.system}}\n", f": check.q._target_ {REFUSED}"
    ),
    on_experiment(
        "hydra: {callbacks: {q: {_target_: os.mkdir, path: ran}}}\n",
        f": hydra.callbacks.q._target_ {REFUSED}",
    ),
    on_experiment(
        "hydra: {job_logging: {handlers: {q: {class: os.mkdir, path: ran}}}}\n",
        ": hydra.job_logging is refused: a file that does not belong to the program may "
        "set only these of hydra: run, …",
    ),
    in_folder(
        "-m experiment=x,pose",
        f"experiment/x.yaml: hydra.callbacks.q._target_ {REFUSED}",
        experiment_x=EXPERIMENT + "hydra: {callbacks: {q: {_target_: os.mkdir, path: ran}}}\n",
    ),
    in_folder(
        "experiment=x",
        f"evil/e.yaml: hydra.callbacks.q._target_ {REFUSED}",
        experiment_x=EXPERIMENT.replace(
            "defaults:\n", "defaults:\n  - /evil@hydra.callbacks.q: e\n"
        ),
        evil_e="_target_: os.mkdir\npath: ran\n",
    ),
    on_pose("+_target_=os.system", f"_target_ {REFUSED}"),
    on_pose("'pose.path={_target_: a.reg}'", f"pose.path._target_ {REFUSED}"),
]

FILES = [
    on_experiment("a: [1,\n", ", line 8: is not YAML: …"),
    on_experiment("pose: {}\n", ", line 7: pose is there twice, first in line 5; …"),
    in_folder(
        "~experiment target=box",
        "target/box.yaml, line 5: circles.3 is there twice, first in line 4; one of them needs "
        "another name",
        target_box="defaults: [schema/circles@_here_, _self_]\nunit: mm\ncircles:\n"
        "  3: {x: 10, y: 10, diameter: 5}\n  3: {x: 30, y: 10, diameter: 5}\n",
    ),
    in_folder(
        "~experiment target=box",
        "target/box.yaml: target.circles.3.diameter is 30 m, which no scanning vibrometer "
        "measures: is the unit m right, or is it mm?",
        target_box="defaults: [schema/circles@_here_, _self_]\ncircles:\n"
        "  3: {x: 10, y: 10, diameter: 30}\n  4: {x: 60, y: 10, diameter: 30}\n",
    ),
    in_folder(
        "~experiment target=box",
        "target/box.yaml: target.fiducials.2 is 300 m, which no scanning vibrometer measures: "
        "is the unit m right, or is it mm?",
        target_box="defaults: [schema/points@_here_, _self_]\nfiducials: {1: {x: 0, y: 1}, "
        "2: {x: 300, y: 10}, 3: {x: 60, y: 400}}\n",
    ),
    in_folder(
        "experiment=x", "experiment/x.yaml: is not a text file", experiment_x=b"\xff\xfe\x00" * 20
    ),
    in_folder(
        "experiment=x",
        "experiment/x.yaml: must begin with the line '# @package _global_', as experiments do",
        experiment_x="pose: {path: a.reg}\n",
    ),
    in_folder(
        "experiment=x",
        "experiment/x.yaml: its defaults must be a list of names, as in '- override "
        "/pose: registration'",
        experiment_x="defaults: 3\n",
    ),
    in_folder(
        "experiment=x",
        "experiment/x.yaml: there is no pose=registrashun; did you mean registration? Valid: …",
        experiment_x=EXPERIMENT.replace("registration\n", "registrashun\n", 1),
    ),
    in_folder(
        "experiment=x",
        "experiment/x.yaml: its defaults override pse, which the configuration does not "
        "have; did you mean pose? Valid: …",
        experiment_x=EXPERIMENT.replace("/pose", "/pse"),
    ),
    in_folder(
        "experiment=x",
        "experiment/x.yaml: pose has settings but no plugin; choose one with pose=name, …",
        experiment_x="# @package _global_\npose: {path: a.reg}\n",
    ),
    Bad(
        "experiment=pose hydra.run.dir=f/sub",
        "f/sub: cannot be written: Not a directory",
        {"f": ""},
    ),
    Bad(
        "experiment=pose hydra.run.dir=/proc/nope",
        "/proc/nope: cannot be written: No such file or directory",
    ),
]

TABLE_OF_ALL = [
    *AVERAGES,
    *CHOICES,
    *KEYS,
    *VALUES,
    *TARGETS,
    *REGISTRATIONS,
    *VELOCITIES,
    *ROUGH_POSES,
    *OTHER_POSES,
    *EXPECTATIONS,
    *CODE,
    *FILES,
]


@pytest.fixture(autouse=True)
def one_composition(monkeypatch):
    """Hydra composes twice, first only for `hydra.mode`, which nothing here sets: half the time."""
    monkeypatch.setattr("hydra._internal.hydra.Hydra.get_mode", lambda *_, **__: None)


def test_there_are_enough():
    assert len({bad.answer for bad in TABLE_OF_ALL}) >= 60


@pytest.mark.one_in(6)
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("bad", TABLE_OF_ALL, ids=lambda bad: bad.arguments)
def test_bad_input_gets_one_sentence(bad, sldvexp, tmp_path):
    for name, content in bad.files.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            content(file)
        else:
            file.write_bytes(content if isinstance(content, bytes) else content.encode())
    done = sldvexp(*shlex.split(bad.arguments))
    wanted = f"sldvexp: {bad.answer.replace('{here}', str(tmp_path))}\n"
    pattern = ".*".join(map(re.escape, wanted.split("…")))
    assert re.fullmatch(pattern, done.err), done.err  # no second line: `.` matches no line break
    assert done.status == 1
    assert "Traceback" not in done.out + done.err
    assert list(tmp_path.rglob("run.nc")) == []
    assert not (tmp_path / "ran").exists()
