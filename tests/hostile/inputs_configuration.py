"""Hostile configuration: command lines, and files of YAML in a folder of others."""

from __future__ import annotations

from collections.abc import Iterator

from inputs import Content, Hostile, fifo, folder, link, sparse

RUN = "--config-dir my experiment=x"
HEAD = "# @package _global_\n"
POSE = (
    HEAD
    + "defaults:\n  - override /pose: registration\n  - _self_\npose: {path: conf://data/figure_4_28.reg}\n"
)
WRITES = "{_target_: pathlib.Path.write_text, self: {_target_: pathlib.Path, _args_: [../beside/x]}, data: x}"
LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n"
    for a, b in zip("abcdefghi", "bcdefghij", strict=True)
)
FIXTURE = "~experiment target=dissertation"


def yaml(
    name: str, text: str | bytes, told: str = "x.yaml", arguments: str = RUN, **more
) -> Hostile:
    """An experiment of others."""
    return Hostile("YAML", name, arguments, {"my/experiment/x.yaml": text}, told, **more)


def others(
    name: str, told: str, arguments: str = RUN, refused: bool = True, **files: Content
) -> Hostile:
    """Several files; ``experiment_x`` is the name of my/experiment/x.yaml."""
    laid = {f"my/{n.replace('_', '/', 1)}.yaml": content for n, content in files.items()}
    return Hostile("YAML", name, arguments, laid, told, refused)


CODE = [
    yaml(f"{key} in {place}", POSE + text.replace("KEY", key), "is refused")
    for key in ("_target_", "_partial_", "_args_", "_x_")
    for place, text in {
        "the root": "KEY: os.abort\n",
        "a list": "expect: {q: {at_most: {a: [{KEY: os.abort}]}}}\n",
        "a named entry": "check: {q: {plugin: printed, KEY: os.abort}}\n",
    }.items()
] + [
    yaml("callbacks", POSE + f"hydra: {{callbacks: {{q: {WRITES}}}}}\n", "is refused"),
    yaml("callbacks, dotted", POSE + f"hydra.callbacks.q: {WRITES}\n", "x.yaml"),
    yaml("callbacks by package", f"# @package hydra.callbacks.q\n{WRITES}\n", ""),
    yaml(
        "a logging handler",
        POSE
        + "hydra: {job_logging: {handlers: {q: {class: logging.FileHandler, filename: ../beside/x}}}}\n",
        "hydra.job_logging is refused",
    ),
    yaml(
        "Hydra's own logging",
        POSE
        + "hydra: {hydra_logging: {handlers: {q: {class: logging.FileHandler, filename: ../beside/x}}}}\n",
        "is refused",
    ),
    yaml(
        "a search path",
        POSE + "hydra: {searchpath: [file:///tmp]}\n",
        "hydra.searchpath is refused",
    ),
    yaml("a launcher", POSE + "hydra: {launcher: {_target_: os.abort}}\n", "is refused"),
    yaml(
        "a sweeper",
        POSE + "hydra: {sweeper: {params: {seed: '1,2'}}}\n",
        "hydra.sweeper is refused",
    ),
    yaml(
        "environment", POSE + "hydra: {job: {env_set: {PATH: x}}}\n", "hydra.job.env_set is refused"
    ),
    yaml(
        "copied environment",
        POSE + "hydra: {job: {env_copy: [HOME]}}\n",
        "hydra.job.env_copy is refused",
    ),
    yaml(
        "output elsewhere",
        POSE + "hydra: {output_subdir: ../../beside}\n",
        "hydra.output_subdir is refused",
    ),
    yaml(
        "a run's folder above",
        POSE + "hydra: {run: {dir: ../beside/x}}\n",
        "hydra.run.dir is refused",
    ),
    yaml(
        "a run's folder anywhere",
        POSE + "hydra: {run: {dir: /tmp/x}}\n",
        "hydra.run.dir is refused",
    ),
    yaml("a run's folder at home", POSE + "hydra: {run: {dir: ~/x}}\n", "hydra.run.dir is refused"),
    yaml(
        "a run's folder by the clock",
        POSE + "hydra: {run: {dir: '${now:../beside/x}'}}\n",
        "hydra.run.dir is refused",
    ),
    yaml(
        "a run's folder by reference",
        POSE + "hydra: {run: {dir: '${pose.path}'}}\n",
        "hydra.run.dir is refused",
    ),
    yaml(
        "a sweep's folder above",
        POSE + "hydra: {sweep: {dir: ../beside/x}}\n",
        "hydra.sweep.dir is refused",
    ),
    yaml(
        "a job's folder above",
        POSE + "hydra: {sweep: {subdir: ../../../beside/x}}\n",
        "hydra.sweep.subdir is refused",
        f"{RUN} -m seed=1,2",
    ),
    yaml(
        "a log elsewhere",
        POSE + "hydra: {job: {name: ../../../beside/x}}\n",
        "hydra.job.name is refused",
    ),
    yaml("the whole of hydra", HEAD + "hydra: 3\n", ""),
    yaml("the environment", POSE + "seed: ${oc.env:HOME}\n", "cannot look up ${oc.env:...}"),
    yaml("the environment, in a list", POSE + "pose: {path: ['${oc.env:HOME}']}\n", ""),
    yaml(
        "the environment, in a key",
        POSE + "check: {'${oc.env:HOME}': {plugin: printed}}\n",
        "cannot look up",
    ),
    yaml("a made node", POSE + "pose: {adjust: '${oc.create:{a: 1}}'}\n", ""),
    yaml("decoded text", POSE + "seed: ${oc.decode:'1'}\n", "cannot look up ${oc.decode:...}"),
    yaml("a resolver by reference", POSE + "seed: '${${pose.path}:1}'\n", "cannot look up"),
    yaml("an unknown resolver", POSE + "seed: ${evil:1}\n", "cannot look up ${evil:...}"),
    yaml("a long reference", POSE + "seed: '" + "${" * 5000 + "'\n", "more than 30 references"),
    yaml(
        "a deep reference",
        POSE + "seed: '" + "${" * 600 + "seed" + "}" * 600 + "'\n",
        "more than 30 references",
    ),
    yaml("a reference to itself", POSE + "seed: ${seed}\n", ""),
    yaml(
        "references in a circle", POSE + "pose: {path: '${pose.unit}', unit: '${pose.path}'}\n", ""
    ),
    others(
        "a callback beside",
        "is refused",
        experiment_x=POSE.replace("defaults:\n", "defaults:\n  - /evil@hydra.callbacks.q: e\n"),
        evil_e=WRITES,
    ),
    others(
        "a list of callbacks",
        "two files choose hydra/callbacks",
        experiment_x=POSE.replace("defaults:\n", "defaults:\n  - /hydra/callbacks: e\n"),
        hydra_callbacks="x: 1\n",
        **{"hydra_callbacks/e": f"q: {WRITES}\n"},
    ),
    others(
        "logging in place of Hydra's",
        "",
        experiment_x=POSE,
        **{
            "hydra_job_logging/default": "version: 1\nhandlers: {q: {class: logging.FileHandler, filename: ../beside/x}}\nroot: {handlers: [q]}\n"
        },
        refused=False,
    ),
    others(
        "a root in place of the program's",
        "is refused",
        arguments="--config-dir my",
        experiment_x=POSE,
        **{
            "config": "defaults: [experiment_schema, experiment_groups, _self_]\nhydra: {callbacks: {q: {_target_: os.abort}}}\n"
        },
    ),
    Hostile(
        "YAML",
        "a root in place of the program's, beside",
        "--config-dir my",
        {
            "my/config.yaml": "defaults: [experiment_schema, experiment_groups, _self_]\nhydra: {callbacks: {q: {_target_: os.abort}}}\n"
        },
        "is refused",
    ),
    Hostile(
        "YAML",
        "a root of another name",
        "--config-dir my --config-name c",
        {
            "my/c.yaml": "defaults: [config, _self_]\nhydra: {callbacks: {q: {_target_: os.abort}}}\n"
        },
        "is refused",
    ),
    Hostile(
        "YAML",
        "chosen by a path",
        "experiment=../../../../../../../../../<here>/x",
        {"x.yaml": POSE + "hydra: {callbacks: {q: {_target_: os.abort}}}\n"},
        "",
    ),
    Hostile(
        "YAML",
        "Hydra's group beside",
        "--config-dir my experiment=pose +hydra/callbacks=e",
        {"my/hydra/callbacks/e.yaml": f"q: {WRITES}\n"},
        "two files choose",
    ),
    others(
        "in one job of a sweep",
        "is refused",
        f"{RUN},pose -m",
        experiment_x=POSE + "hydra: {callbacks: {q: {_target_: os.abort}}}\n",
    ),
]
BOUNDS = [
    yaml("a billion laughs", LAUGHS, "has more than 20000 values"),
    yaml(
        "laughs in settings",
        POSE + LAUGHS.replace("\n", "\n").replace("a: &a", "seed: &a"),
        "x.yaml, line",
    ),
    yaml(
        "laughs with merges",
        HEAD
        + "a: &a {x: 1}\n"
        + "".join(
            f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}' if i else '*a'] * 50)}]}}\n"
            for i in range(20)
        ),
        "x.yaml, line",
    ),
    yaml("deep lists", HEAD + "a: " + "[" * 100_000, "more than 60 deep"),
    yaml("deep lists, closed", HEAD + "a: " + "[" * 1000 + "]" * 1000, "more than 60 deep"),
    yaml("deep tables", HEAD + "a: " + "{a: " * 5000, "more than 60 deep"),
    yaml("deep blocks", HEAD + "".join(" " * i + "a:\n" for i in range(900)), "more than 60 deep"),
    yaml("deep dashes", HEAD + "a:\n" + "- " * 3000 + "x\n", "more than 60 deep"),
    yaml("a list in itself", HEAD + "a: &a [*a]\n", "a refers to itself"),
    yaml("a table in itself", HEAD + "a: &a {b: *a}\n", "a refers to itself"),
    yaml("a megabyte of text", HEAD + "# " + "x" * 2**21, "has 2 MB, more than the 1 MB"),
    yaml("a long value", POSE + "seed: " + "9" * 500_000 + "\n", "x.yaml"),
    yaml("a long key", POSE + "x" * 500_000 + ": 1\n", "x.yaml"),
    yaml("many keys", HEAD + "".join(f"k{i}: 1\n" for i in range(50_000)), "x.yaml"),
    yaml("many questions", HEAD + "? " * 100_000, "x.yaml"),
    yaml("many defaults", HEAD + "defaults: [" + ", ".join(["pose"] * 30_000) + "]\n", "x.yaml"),
    yaml("an object", HEAD + "a: !!python/object/apply:os.abort []\n", "x.yaml"),
    yaml("a module", HEAD + "a: !!python/module:os\n", "x.yaml"),
    yaml("an unknown tag", HEAD + "a: !x 1\n", "x.yaml"),
    yaml("a date that is none", POSE + "seed: 2026-99-99\n", "x.yaml"),
    yaml("a table as a key", HEAD + "? {a: 1}\n: 2\n", "x.yaml"),
    yaml("a list as a key", HEAD + "[a]: 2\n", "x.yaml"),
    yaml("two documents", HEAD + "a: 1\n---\nb: 2\n", "x.yaml"),
    yaml("a number with colons", POSE + "seed: 9999999:59:59\n", "", refused=False),
    yaml("an endless number", POSE + "seed: 0x" + "f" * 5000 + "\n", ""),
    yaml("binary", HEAD + "a: !!binary x\n", "x.yaml"),
    yaml("zeros", b"\0" * 100),
    yaml("Latin-1", "# é\n".encode("latin-1")),
    yaml("UTF-16", POSE.encode("utf-16")),
    yaml("a scalar", "3\n"),
    yaml("a list", "[1, 2]\n"),
    yaml("escape codes", HEAD + '"\\e[2J": 1\n', "x.yaml"),
    yaml("includes itself", HEAD + "defaults: [x]\n", "x"),
    others(
        "include each other",
        "includes itself",
        experiment_x=HEAD + "defaults: [y]\n",
        experiment_y=HEAD + "defaults: [x]\n",
    ),
    yaml("defaults of defaults", HEAD + "defaults: {a: [b, {c: d}]}\n"),
    yaml("defaults with a path", HEAD + "defaults: ['../../../../../etc/passwd']\n", ""),
    yaml("defaults with a device", HEAD + "defaults: ['/../../../../../../../../dev/zero']\n", ""),
    Hostile("YAML", "3 GB", RUN, {"my/experiment/x.yaml": sparse}, "x.yaml"),
    Hostile(
        "YAML",
        "3 GB beside",
        "--config-dir my experiment=pose seed=x",
        {"my/experiment/x.yaml": sparse},
        "seed must be",
    ),
    Hostile("YAML", "a device", RUN, {"my/experiment/x.yaml": link("/dev/zero")}, ""),
    Hostile("YAML", "a pipe", RUN, {"my/experiment/x.yaml": fifo}, ""),
    Hostile(
        "YAML",
        "a pipe beside",
        "--config-dir my experiment=nope",
        {"my/experiment/x.yaml": fifo},
        "there is no experiment=nope",
    ),
    Hostile(
        "YAML",
        "laughs beside",
        "--config-dir my experiment=nope",
        {"my/experiment/x.yaml": LAUGHS},
        "there is no experiment=nope",
    ),
    Hostile("YAML", "a folder", RUN, {"my/experiment/x.yaml": folder}, ""),
    Hostile(
        "YAML",
        "a folder in itself",
        "--config-dir my experiment=nope",
        {"my/experiment/loop": link("..")},
        "there is no experiment=nope",
    ),
    Hostile("YAML", "a broken link", RUN, {"my/experiment/x.yaml": link("nowhere")}, ""),
    Hostile(
        "YAML",
        "a device for a folder",
        "--config-dir /dev/zero experiment=x",
        {},
        "there is no folder",
    ),
    Hostile(
        "YAML",
        "laughs to be listed",
        "list --config-dir my experiment",
        {"my/experiment/x.yaml": LAUGHS},
        "",
        refused=False,
    ),
    Hostile(
        "YAML",
        "3 GB to be listed",
        "list --config-dir my experiment",
        {"my/experiment/x.yaml": sparse},
        "",
        refused=False,
    ),
    Hostile(
        "YAML",
        "laughs to be shown",
        "show --config-dir my experiment=x",
        {"my/experiment/x.yaml": LAUGHS},
        "x.yaml",
    ),
    Hostile(
        "YAML",
        "laughs to be checked",
        "check my",
        {"my/experiment/x.yaml": LAUGHS},
        "",
        refused=False,
    ),
    Hostile("YAML", "laughs in a matrix", "check m.yaml", {"m.yaml": LAUGHS}, "m.yaml, line"),
    Hostile(
        "YAML",
        "a matrix of 10^12",
        "check m.yaml",
        {"m.yaml": "axes: {" + ", ".join(f"a{i}: {[*range(10)]}" for i in range(12)) + "}\n"},
        "m.yaml",
    ),
    Hostile(
        "YAML",
        "a slow pattern in a matrix",
        "check m.yaml",
        {"m.yaml": "axes: {seed: [-1]}\nrules: [{refused: '(.*a)+$'}]\n"},
        "repetition in a repetition",
    ),
    Hostile(
        "YAML",
        "code in a matrix",
        "check m.yaml",
        {"m.yaml": "axes: {seed: [1]}\nsettings: {pose.path: {_target_: os.abort}}\n"},
        "",
        refused=False,
    ),
    Hostile(
        "YAML",
        "Hydra's in a matrix",
        "check m.yaml",
        {"m.yaml": "axes: {hydra/callbacks: [x]}\n"},
        "cannot be set here",
    ),
    Hostile(
        "YAML",
        "the environment in a matrix",
        "check m.yaml",
        {"m.yaml": "axes: {seed: ['${oc.env:HOME}']}\n"},
        "m.yaml",
    ),
    Hostile(
        "YAML",
        "a path in a matrix",
        "check m.yaml",
        {
            "m.yaml": "axes: {experiment: ['../../../../../../../../<here>/x']}\n",
            "x.yaml": POSE + "hydra: {callbacks: {q: {_target_: os.abort}}}\n",
        },
        "",
        refused=False,
    ),
]


NAMES = ("../../beside/x", "/tmp/x", "..", "", "a/b", "\\0", "n" * 5000, "\\e[2J", "-30 deg", "#1")
SCAN = (
    HEAD
    + """defaults:
  - _self_
  - override /scene: plate
  - override /scan: rectangle
  - override /instrument: simulated
  - override /signal: sine_fit
  - override /report: none
scene: {views: {NAME: {euler: [0.024, 2.910, -3.117], origin: [0.290, 0.530, 1.655]}}}
scan: {views: {NAME: {corners: [[-64, 14], [-64, -144], [64, -144], [64, 14]]}}, pixels: [2, 2]}
"""
)
PLACES_OF_NAMES = {
    "view": SCAN,
    "check": POSE + "check: {NAME: {plugin: pose_repeats}}\n",
    "export": POSE + "export: {NAME: {plugin: reg}}\n",
    "pose": POSE
    + "compare_pose: {NAME: {plugin: registration, path: conf://data/figure_4_28.reg}}\n",
    "expectation": POSE + "expect: {NAME: {at_most: {pose/sse: 1}}}\n",
}
NAMED = [
    yaml(f"a {of} named {name[:20]!r}", text.replace("NAME", f'"{name}"'), "", refused=False)
    for of, text in PLACES_OF_NAMES.items()
    for name in NAMES
]


def command_lines() -> Iterator[Hostile]:
    """What a line may hold."""
    lines = {
        "10^9 jobs": (f"-m {FIXTURE} 'seed=range(1,1000000000)'", "command line"),
        "jobs by products": (
            f"-m {FIXTURE} seed={','.join(map(str, range(3000)))} laser.mirror_offset={','.join(map(str, range(3000)))}",
            "command line",
        ),
        "10^12 samples": ("experiment=plate scan.structure.sampling.samples=1000000000000", ""),
        "10^10 pixels": ("experiment=plate 'scan.structure.pixels=[100000,100000]'", ""),
        "10^10 nodes": ("experiment=plate 'volume.shape=[100000,100000]'", ""),
        "10^9 layers": ("experiment=plate volume.layers=1000000000", ""),
        "a large number": (f"{FIXTURE} seed={'9' * 5000}", ""),
        "a large power": (f"{FIXTURE} laser.mirror_offset=1e999999999", ""),
        "deep lists": (f"experiment=pose pose.inverted={'[' * 2000}{']' * 2000}", "command line"),
        "deep tables": (
            "experiment=pose pose.adjust=" + "{a:" * 1500 + "1" + "}" * 1500,
            "command line",
        ),
        "deep calls": ("experiment=pose seed=" + "int(" * 1500 + "1" + ")" * 1500, "command line"),
        "deep references": ("experiment=pose 'seed=" + "${" * 600 + "}" * 600 + "'", ""),
        "a long key": (f"{FIXTURE} {'k' * 100_000}=1", "command line"),
        "a long dotted key": (f"{FIXTURE} {'.'.join('k' * 5000)}=1", "command line"),
        "a long value": (f"experiment=pose pose.path={'v' * 100_000}.reg", ""),
        "a long word": ("w" * 100_000, "command line"),
        "a long folder": (f"{FIXTURE} hydra.run.dir={'d' * 300}", ""),
        "a deep folder": (f"{FIXTURE} hydra.run.dir={'d/' * 2500}", ""),
        "no folder": (f"{FIXTURE} hydra.run.dir=", ""),
        "a device as a folder": (f"{FIXTURE} hydra.run.dir=/dev/null/x", "/dev/null"),
        "escape codes": (f"{FIXTURE} '\x1b[2Jseed=1'", "command line"),
        "bytes that are no text": ("experiment=pose 'pose.path=\udcff.reg'", ""),
        "bytes in a key": (f"{FIXTURE} '\udcff=1'", "command line"),
        "right to left": (f"{FIXTURE} '\u202eseed=1'", "command line"),
        "a line end": (f"{FIXTURE} 'seed=1\nlaser=x'", "command line"),
        "an empty word": (f"{FIXTURE} ''", ""),
        "a pickle": ("--experimental-rerun x.pickle", ""),
        "a pickle that is there": ("--experimental-rerun config.pickle", "command line"),
        "unknown option": ("--evil", "command line"),
        "list of a device": ("list /dev/zero", "command line"),
        "show of a path": ("show pose=../../x", "command line"),
        "handbook of a path": ("handbook ../../../etc/passwd", "command line"),
        "check of a device": ("check /dev/zero", ""),
        "check of a pipe": ("check pipe", ""),
        "report of a device": ("report /dev/zero", "/dev/zero"),
        "plot of a device": ("plot /dev/zero", "/dev/zero"),
        "export of a device": ("export /dev/zero csv", "/dev/zero"),
        "rerun of a device": ("rerun /dev/zero", "/dev/zero"),
        "compare of devices": ("compare /dev/zero /dev/zero", "/dev/zero"),
        "resume of a device": ("resume=/dev/zero", "resume=/dev/zero"),
        "report of a pipe": ("report pipe", "pipe"),
        "plot of a pipe": ("plot pipe", "pipe"),
        "export of a pipe": ("export pipe csv", "pipe"),
        "rerun of a pipe": ("rerun pipe", "pipe"),
        "resume of a pipe": ("resume=pipe", "pipe"),
        "resume of a long name": (f"resume={'r' * 5000}", ""),
        "report of a long name": (f"report {'r' * 5000}", ""),
        "plot of a long name": (f"plot {'r' * 5000}", ""),
        "rerun of a long name": (f"rerun {'r' * 5000}", ""),
        "export with a path": ("export . csv csv.path=../beside/x", ""),
        "config-dir of a long name": (f"--config-dir {'r' * 5000} experiment=x", ""),
        "config-dir of all": ("--config-dir / experiment=nope", "there is no experiment=nope"),
        "lists of all": ("list experiment --config-dir /", ""),
    }
    for name, (arguments, told) in lines.items():
        yield Hostile(
            "command line",
            name,
            arguments,
            {"pipe": fifo, "config.pickle": b"cos\nabort\n(tR."},
            told,
            refused=name not in ("lists of all", "no folder"),
        )


INPUTS = [*CODE, *BOUNDS, *NAMED, *command_lines()]
