"""Files that are wrong: registrations, velocities, poses, configurations, and code in these."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from tests.cli.bad_input import (
    EXPERIMENT,
    Bad,
    Content,
    in_folder,
    on_experiment,
    on_given,
    on_pose,
)

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
REFUSED = "is refused: a configuration names plugins and cannot name code"


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

BAD_FILES = [
    *REGISTRATIONS,
    *VELOCITIES,
    *OTHER_POSES,
    *CODE,
    *FILES,
]
