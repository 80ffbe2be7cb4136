"""Settings that are wrong: on the command line, in files of a configuration, or two together."""

from __future__ import annotations

from tests.cli.bad_input import EXPERIMENT, Bad, in_folder, on_experiment, on_given, on_pose

OBJECT = "~experiment target=dissertation"
KNOWN = "{euler: [0, 0, 0], origin: [0, 0, 1]}"


def on_target(setting: str, answer: str) -> Bad:
    return Bad(f"{OBJECT} '{setting}'", f"command line: {answer}")


def on_averages(arguments: str, answer: str) -> Bad:
    return Bad(f"experiment=plate_broadband scan.pixels=[2,3] {arguments}", answer)


def on_rough_pose(setting: str, answer: str) -> Bad:
    return Bad(f"~experiment target=dissertation instrument=simulated {setting}", answer)


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

BAD_SETTINGS = [
    *AVERAGES,
    *CHOICES,
    *KEYS,
    *VALUES,
    *TARGETS,
    *ROUGH_POSES,
    *EXPECTATIONS,
]
