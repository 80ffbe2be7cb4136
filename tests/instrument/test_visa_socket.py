"""The whole way over a real socket, which needs nothing but the commands."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.instrument import Acquisition, InstrumentError
from sldvexp.instrument.visa import Visa
from sldvexp.stopping import handlers_kept
from sldvexp.virtual_lab import LabServer, VirtualLab, console

CONF = Path(__file__).parents[2] / "conf"

pytestmark = pytest.mark.usefixtures("client_clock")

#: How long an answer or the end of a process is waited for, s.
LONGEST = 300.0

ACQUISITION = Acquisition(10000.0, 256, (450.0,))


def test_a_whole_calibration_object(lab, same):
    """8,000 pixels in lines of 300."""
    reference = lab()
    reference.configure(ACQUISITION)
    dac = np.random.default_rng(1).integers(-700, 700, (8000, 2))
    lines = [dac[begin : begin + 300] for begin in range(0, len(dac), 300)]
    wanted = [reference.scan(line, stream=i) for i, line in enumerate(lines)]
    with LabServer(lab()) as server, Visa(server.resource).open() as ours:
        ours.configure(ACQUISITION)
        found = [ours.scan(line, stream=i) for i, line in enumerate(lines)]
    assert all(map(same, found, wanted))


def test_a_question_after_a_command_does_not_wait(lab):
    """Without TCP_NODELAY every pair takes 40 ms or more; some may also where others compute."""
    took = []
    with LabServer(lab()) as server, Visa(server.resource).open() as ours:
        for step in range(100):
            begin = time.perf_counter()
            ours.move([step, -step])
            took.append(time.perf_counter() - begin)
        assert np.median(took) < 0.02
        assert server.dialect.lab.position == (99, -99)


def test_a_view_that_the_lab_does_not_know(lab):
    said = "no view front; Valid: 1.*; scan.views calls a view front: call it as the instrument do"
    with LabServer(lab()) as server:
        with pytest.raises(InstrumentError, match=said), Visa(server.resource).open(view="front"):
            pass
        with Visa(server.resource).open(view="1"):
            assert server.dialect.lab.view == "1"


def test_a_digitiser_that_takes_no_lists(lab, same, line, tmp_path):
    """Without `scan` in its profile, pixel by pixel; the same comes out."""
    source = (CONF / "profile" / "virtual_lab.yaml").read_text()
    listing = '  scan: {lab: ["MEAS:LIST {positions}"]}\n'
    assert listing in source
    file = tmp_path / "pixels.yaml"
    file.write_text(source.replace(listing, ""))
    reference = lab()
    reference.configure(ACQUISITION)
    with LabServer(lab()) as server, Visa(server.resource, str(file)).open() as ours:
        ours.configure(ACQUISITION)
        assert same(ours.scan(line, stream=3), reference.scan(line, stream=3))
        assert server.dialect.lab.position == tuple(line[-1])


def test_one_client_after_the_other(lab, line, same):
    reference = lab()
    reference.configure(ACQUISITION)
    with LabServer(lab()) as server:
        for stream in (1, 2):
            with Visa(server.resource).open() as ours:
                ours.configure(ACQUISITION)
                assert same(ours.scan(line, stream=stream), reference.scan(line, stream=stream))


def test_the_server_answers_whoever_speaks_its_language(lab):
    with (
        LabServer(lab()) as server,
        socket.create_connection(server._listener.getsockname(), timeout=LONGEST) as link,
        link.makefile("rb") as answers,
    ):

        def ask(*lines):
            link.sendall(b"".join(line.encode() + b"\n" for line in lines))
            return answers.readline().decode().strip()

        assert ask("*IDN?").startswith("sldvexp,virtual lab,0,")
        assert ask("MIRR:POS 3,-4", "", "MIRR:POS?") == "3,-4"
        assert ask("SYST:ERR?") == '0,"No error"'
        assert ask("SAMP:RATE 0.1", "SAMP:RATE?") == "0.1"
        assert ask("HELLO 1", "SYST:ERR?") == '-113,"Undefined header; HELLO"'
        assert ask("SAMP:COUN many", "SYST:ERR?").startswith('-104,"Data type error; SAMP:COUN')
        assert ask("MIRR:POS 3", "SYST:ERR?").startswith('-222,"Data out of range; move: needs')
        assert ask("MEAS:LIST 1,2,3", "SYST:ERR?").startswith('-104,"Data type error; MEAS:LIST')
        assert ask("VIEW 9", "SYST:ERR?").startswith('-222,"Data out of range; the scene has no')
        assert ask("DATA?") == "#10"
        assert ask("SYST:ERR?") == '-221,"Settings conflict; nothing was measured"'
        assert ask("HELLO", "*CLS", "SYST:ERR?") == '0,"No error"'
        assert ask("GEN:FREQ 1,nan", "SYST:ERR?").startswith('-222,"Data out of range; configure')
        assert ask("GEN:OUTP 1", "GEN:OUTP?", "GEN:OUTP 0") == "1"


@pytest.fixture
def served():
    """Start `sldvexp-lab` as a user does; its process and the name that it prints."""
    started = []

    def start(*arguments):
        command = [sys.executable, "-m", "sldvexp.virtual_lab.console", "--port", "0", *arguments]
        both = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        # Whoever runs the tests in the background of a shell ignores SIGINT, and so would it.
        heeds = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
        process = subprocess.Popen(command, text=True, cwd=CONF.parent, preexec_fn=heeds, **both)
        started.append(process)
        return process, process.stdout.readline().strip()

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.mark.whole
def test_the_command_serves_the_lab_of_its_configuration(served, lab, line, same):
    chosen = ("scene=plate", "target=two_planes", "laser=ometron_16bit", "seed=5")
    process, resource = served(*chosen)
    reference = lab(*chosen)
    reference.use_view("4")
    reference.configure(ACQUISITION)
    with Visa(resource).open(view="4") as ours:
        ours.configure(ACQUISITION)
        assert same(ours.scan(line, stream=0), reference.scan(line, stream=0))
    process.send_signal(signal.SIGINT)
    assert process.wait(LONGEST) == 0
    assert process.stderr.read() == ""


@pytest.mark.whole
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_lab_that_is_ended_says_so(served, number):
    assert_ends_with_a_word(*served(), number)


def assert_ends_with_a_word(process, resource, number):
    process.send_signal(number)
    assert process.wait(LONGEST) == 0
    assert process.stdout.read().splitlines()[-1] == f"the virtual lab at {resource} has ended"
    assert process.stderr.read() == ""


def test_by_default_it_is_the_lab_of_the_automated_pose():
    made = console.experiment([])
    assert type(made.scene).__name__ == "CalibrationScene"
    assert type(made.target).__name__ == "Circles"


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (["scene=calibratio"], "there is no scene=calibratio; did you mean calibration"),
        (["scene.washer=-1"], "scene.washer must be zero or a positive number, not -1"),
        (["seed=x"], "seed must be a whole number, not x"),
        (["seed=-1"], "seed must be zero or a positive integer, not -1"),
        (["scene.speakers={9: {}}"], "scene.speakers.9: the calibration object has no circle 9"),
        (["experiment=pose", "pose.path=x.reg"], "there is no scene to serve; choose scene=annu"),
        (["experiment=nothing"], "there is no experiment=nothing"),
    ],
)
def test_what_cannot_be_served(settings, told):
    with pytest.raises(UserError, match=told):
        console.serve(settings, port=0)


#: An own object, an own laser and an own plate, as a user's folder has them.
OWN = {
    "target/mine": "defaults: [schema/circles@_here_, _self_]\nunit: mm\ncircles:\n"
    "  1: {x: 20, y: 20, diameter: 30}\n  2: {x: 180, y: 25, diameter: 30}\n"
    "  3: {x: 90, y: 170, diameter: 30}\n",
    "laser/mine": "defaults: [schema/two_mirror@_here_, _self_]\nup_down: {gain: 20}\n",
    "scene/mine": "defaults: [schema/plate@_here_, _self_]\n"
    "views: {front: {origin: [450, 100, 2000], look_at: [450, 100, 0], unit: mm}}\n"
    "plate: {size: [0.6, 0.4], center: [0.55, 0.1, 0], modes: {a: {x: 2, y: 1}}}\n",
    "experiment/mine": "# @package _global_\ndefaults:\n  - override /target: mine\n"
    "  - override /laser: mine\n  - override /scene: mine\n",
}


@pytest.fixture
def own_folder(tmp_path):
    for name, text in OWN.items():
        file = tmp_path / f"lab/{name}.yaml"
        file.parent.mkdir(parents=True)
        file.write_text(text)
    return tmp_path / "lab"


@pytest.mark.whole
def test_the_command_serves_what_a_folder_of_ones_own_has_and_says_when_it_ends(served, own_folder):
    process, resource = served("--config-dir", str(own_folder), "experiment=mine", "scene.noise=0")
    made = console.experiment(["experiment=mine"], str(own_folder))
    assert list(made.scene.views) == ["front"]
    lab = VirtualLab(made.scene, made.laser, made.target, made.seed)
    lab.use_view("front")
    assert lab.plate.position([[0.6, 0.4]]) == pytest.approx(np.array([[0.85, 0.3, 0.0015]]))
    circle, plate, beside = (
        lab.true_dac(p) for p in ([0.02, 0.02, 0], [0.4, 0.1, 0], [0.1, 0.1, 0])
    )
    with Visa(resource).open(view="front") as ours:
        ours.configure(ACQUISITION)
        samples = ours.scan(np.rint([circle, plate, beside]).astype(int), stream=0)
    seen = np.ptp(samples.counts[:, 0].astype(float), axis=1)
    assert seen[0] > 20 * seen[2]
    assert seen[1] > 20 * seen[2]
    assert_ends_with_a_word(process, resource, signal.SIGTERM)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        (
            "experiment/mine",
            "# @package _global_\nhydra: {callbacks: {q: {_target_: os.mkdir, path: ran}}}\n",
            r"experiment/mine.yaml: hydra.callbacks.q._target_ is refused: a configuration names",
        ),
        (
            "laser/mine",
            "mirror_offset: ${oc.env:HOME}\n",
            r"laser/mine.yaml: laser.mirror_offset is re",
        ),
        ("target/mine", "circles: [\n", r"target/mine.yaml, line \d+: is not YAML"),
        (
            "scene/mine",
            "defaults: [schema/plate@_here_]\nplates: {}\n",
            "scene.plates is not a known",
        ),
    ],
)
def test_a_strange_folder_is_held_to_the_same_rules(own_folder, name, text, told):
    (own_folder / f"{name}.yaml").write_text(text)
    with pytest.raises(UserError, match=told) as error:
        console.serve(["experiment=mine"], port=0, config_dir=str(own_folder))
    assert "\n" not in str(error.value)


#: A plan of stands, as `sldvexp plan` writes it of an experiment that has no scene.
PLANNED = (
    "# @package _global_\ndefaults:\n  - override /target: mine\n  - override /laser: mine\n"
    "  - override /scan: session\n"
    "scan:\n  poses:\n    '1': {origin: [-0.9, 1.1, 1.2], look_at: [0.4, 0.1, 0]}\n"
    "    front: {origin: [0.46, 0.09, 2.02], look_at: [0.45, 0.1, 0]}\n"
)


@pytest.mark.whole
def test_stands_that_are_planned_are_served_in_any_scene(served, own_folder):
    (own_folder / "experiment" / "planned.yaml").write_text(PLANNED)
    chosen = ["experiment=planned", "scene=mine"]
    scene, told = console.with_planned_stands(console.experiment(chosen, str(own_folder)))
    assert scene.views["front"].origin == [450, 100, 2000]  # as near as a person stands
    assert scene.views["1"].origin == [-0.9, 1.1, 1.2]
    assert told == [
        "view front: the instrument stands at (0.450, 0.100, 2.000) m, from scene.views, "
        "0.024 m beside scan.poses",
        "view 1: the instrument stands at (-0.900, 1.100, 1.200) m, from scan.poses",
    ]
    process, resource = served("--config-dir", str(own_folder), *chosen)
    assert process.stdout.readline() == told[0] + "\n"
    with Visa(resource).open(view="1") as ours:
        ours.configure(ACQUISITION)


def test_a_stand_that_only_has_the_name_of_a_planned_one_is_another(own_folder):
    (own_folder / "experiment" / "planned.yaml").write_text(PLANNED.replace("2.02", "1.5"))
    made = console.experiment(["experiment=planned", "scene=mine"], str(own_folder))
    scene, told = console.with_planned_stands(made)
    assert scene.views["front"].origin == [0.46, 0.09, 1.5]
    assert told[0] == (
        "view front: the instrument stands at (0.460, 0.090, 1.500) m, from scan.poses, and not "
        "0.50 m beside it as scene.views has it"
    )


@pytest.mark.whole
def test_a_scene_without_views_has_those_of_the_plan(served, own_folder):
    (own_folder / "experiment" / "planned.yaml").write_text(PLANNED)
    scene = own_folder / "scene" / "bare.yaml"
    scene.write_text(
        "defaults: [schema/plate@_here_, _self_]\n"
        "plate: {size: [0.3, 0.2], modes: {bending: {x: 1, y: 1, velocity: 0.01}}}\n"
    )
    chosen = ["experiment=planned", "scene=bare"]
    process, resource = served("--config-dir", str(own_folder), *chosen)
    assert "view 1: the instrument stands at (-0.900" in process.stdout.readline()
    with Visa(resource).open(view="1") as ours:
        ours.configure(ACQUISITION)
    with pytest.raises(UserError, match=r"scene\.views: give at least one view, .*scan\.poses"):
        console.serve(["~experiment", *chosen[1:]], port=0, config_dir=str(own_folder))


def test_who_chooses_no_scene_is_told_their_own_ones(own_folder):
    (own_folder / "experiment" / "planned.yaml").write_text(PLANNED)
    with pytest.raises(UserError, match=r"there is no scene to serve; choose scene=mine$"):
        console.serve(["experiment=planned"], port=0, config_dir=str(own_folder))


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(UserError, match=r"command line: there is no folder .*/nowhere"):
        console.serve([], port=0, config_dir=str(tmp_path / "nowhere"))


def test_a_port_that_is_taken(capsys, monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        monkeypatch.setattr(sys, "argv", ["sldvexp-lab", "--port", port])
        with pytest.raises(SystemExit, match="1"), handlers_kept():
            console.main()
    told = f"sldvexp-lab: cannot listen on 127.0.0.1, port {port}: Address already in use; --port 0"
    assert capsys.readouterr().err.startswith(told)
