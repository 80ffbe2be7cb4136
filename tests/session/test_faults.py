"""Whatever is wrong with the instrument: a right result, or a sentence that names the cause."""

from __future__ import annotations

import functools
import re
import shutil
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp.config import hydra_plugin
from sldvexp.geometry import vector_from_rotation
from sldvexp.instrument import dialogue
from sldvexp.testing import faults as f
from sldvexp.virtual_lab import LabServer, VirtualLab
from tests import composing

CONF = Path(__file__).parents[2] / "conf"
hydra_plugin.install()

pytestmark = pytest.mark.usefixtures("client_clock")

#: A whole automated pose with a third of the dissertation's pixels.
SMALL = (
    "experiment=dissertation/automated_pose",
    "scan.coarse.pixels=180",
    "scan.fine.lines=8",
    "scan.sampling.samples=64",
    "~expect.truth",
    "~expect.residuals",
)
#: Over the socket: nobody waits long, and steps are repeated twice.
SOCKET = ("instrument=visa", "instrument.timeout=0.3", "instrument.retries=2")
ALWAYS = 10**6
#: A fault must be found where nothing else is wrong.
IDEAL = "scene.pointing=ideal"
#: Largest error of a right pose, in its standard errors.
WITHIN = 4.0

UP_DOWN, LEFT_RIGHT = (f"scene.mirrors.{m}.gain=-2" for m in ("up_down", "left_right"))
SWAPPED = "scene.mirrors.swapped=true"
BESIDE = "scan.views.1.dac=[[1000,1000],[1400,1000],[1400,1400],[1000,1400]]"
ROUGH = "[-142,-704],[-401,-1326],[673,-1632]"
#: The same centres in steps of another board, whose lines stride over eight of its steps.
FINER_BOARD = (
    "laser=ometron_16bit",
    "scan.views.1.dac=[[-1136,-5632],[-3208,-10608],[5384,-13056],[5984,-5168]]",
)
KEPT = r"; what was scanned is kept, go on with: sldvexp resume=\S+$"
AGAIN = r"; then delete \S+/journal/1 and resume the run$"
WIRED = r"^sldvexp: view 1: the mirrors look wired wrongly, "


@dataclass(frozen=True)
class Row:
    """A fault and what must come of it.

    Parameters
    ----------
    name : str
    told : str
        Regular expression of the sentence; empty if the result must be right all the same.
    lab : tuple of str
        What is wrong with the laboratory, and the program cannot know.
    settings : tuple of str
        What the operator chose.
    line : tuple of callable
        What goes wrong between the program and the instrument, each makes a fault.
    noted : str
        Regular expression of what a run must note that finds a pose.
    socket : bool
        Whether the laboratory is another program, with a configuration of its own.
    long : bool
        Whether it is left to the long tests.
    """

    name: str
    told: str = ""
    lab: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    line: tuple[Callable[[], f.Fault], ...] = ()
    noted: str = ""
    socket: bool = False
    long: bool = False

    def __str__(self) -> str:
        return self.name.replace(" ", "_")


def once(fault, command="DATA?", **how):
    return (partial(fault, command, after=3, **how),)


def always(fault, command="DATA?", **how):
    return (partial(fault, command, after=3, times=ALWAYS, **how),)


FLOAT = ("instrument.profile=volts.yaml",)
EVERY_BLOCK_AS_VOLTS = partial(f.Volts, "DATA?", times=ALWAYS)

TABLE = [
    # Between the program and the instrument, for a moment and for good.
    Row("silence", line=once(f.Silence), long=True),
    Row("silence for good", r"no answer within \S+ s after 'DATA\?' \(tried 3 times\)" + KEPT,
        line=always(f.Silence)),
    Row("slow answers", line=(partial(f.Slow, "DATA?", times=9, delay=0.05, parts=3),)),
    Row("too slow", r"no answer within \S+ s after 'DATA\?'.*" + KEPT,
        line=always(f.Slow, delay=0.8), long=True),
    Row("garbage", line=once(f.Garbage)),
    Row("garbage for good", r"to DATA\?, which is not the beginning of a block.*" + KEPT,
        line=always(f.Garbage), long=True),
    Row("short block", line=once(f.ShortBlock)),
    Row("short block for good", r"lab announced \d+ bytes to answer DATA\?, where \d+ had to.*"
        + KEPT, line=always(f.ShortBlock), long=True),
    Row("volts", settings=FLOAT, line=(EVERY_BLOCK_AS_VOLTS,), long=True),
    Row("a sample that is no number", settings=FLOAT,
        line=(partial(EVERY_BLOCK_AS_VOLTS, spoilt=3),)),
    Row("samples that are no numbers", r"pixel 0 has a sample that is not a finite number of volts "
        r"\(tried once\)" + KEPT, settings=(*FLOAT, "instrument.retries=0"),
        line=(partial(EVERY_BLOCK_AS_VOLTS, spoilt=3),), long=True),
    Row("disconnected within a block", line=once(f.Disconnect, sent=1000)),
    Row("disconnected for good", r"the connection was lost in the middle of the answer after "
        r"'DATA\?'.*" + KEPT, line=always(f.Disconnect, sent=1000), long=True),
    Row("an entry in the error queue", r'lab reports -240,"Hardware error; the spindle is bent" '
        r"after 'MEAS:LIST .*" + KEPT,
        line=once(f.Refusal, "MEAS:LIST", text="Hardware error; the spindle is bent")),
    Row("an entry that steers the terminal", r'lab reports -240,"Hot" after ' + ".*" + KEPT,
        line=once(f.Refusal, "MEAS:LIST", text="\x1b[31;5mHot\x1b[0m\x07\x1b]0;title\x07\x08"),
        long=True),
    Row("generator dies", r"the generator's output is off: lab answered '0' to GEN:OUTP\?.*" + KEPT,
        line=once(f.GeneratorDies, "MEAS:STR"), long=True),
    Row("shutter closes", r"the laser's shutter is closed: lab answered 'CLOSED' to LAS:SHUT.*"
        + KEPT, line=once(f.ShutterCloses, "MEAS:STR")),
    # Signals.
    Row("generator off", r"the reference channel has no signal of 450 Hz \(.* V\), and nothing "
        "moves; the generator's output is off" + AGAIN, lab=("scene.generator_gain=0",)),
    Row("reference not plugged in", r"the reference channel has no signal of 450 Hz \(.* V\), "
        "though something moves; its cable from the generator is not plugged in" + AGAIN,
        lab=("scene.digitizer.reference_gain=0",)),
    Row("channels exchanged", "the channels look exchanged, and so every phase conjugated: .*; "
        "exchange their cables, or the profile's data.channels" + AGAIN,
        lab=("scene.digitizer.exchanged=true",)),
    Row("channels exchanged in the profile", "the channels look exchanged, and so every phase",
        settings=("instrument.profile=exchanged.yaml",), socket=True, long=True),
    Row("wrong frequency", "the reference channel carries something else than 450 Hz: .*; the "
        "generator plays other frequencies than the scan's sampling says" + ".*" + AGAIN,
        lab=("scene.generator_error=0.5",)),
    Row("wrong frequency, looked for", lab=("scene.generator_error=0.2",),
        settings=("signal.refine=true", "signal.search=150"), long=True),
    Row("slightly wrong frequency", lab=("scene.generator_error=0.01",), long=True),
    Row("saturated digitizer", r"\d+ of 540 pixels are saturated; choose a larger range .*" + AGAIN,
        lab=("scene.digitizer.velocity_range=0.4",)),
    Row("vibrometer over its range", r"\d+ of 540 pixels are saturated; choose a larger range of "
        "the vibrometer .*" + AGAIN,
        lab=("scene.vibrometer.full_scale=0.004", "scene.digitizer.velocity_range=12")),
    Row("saturated reference", r"540 of 540 pixels are saturated; choose a larger range .*" + AGAIN,
        lab=("scene.digitizer.reference_range=0.4",)),
    Row("drop-outs", lab=("scene.vibrometer.drop_out=0.2",)),
    Row("drop-outs that nobody reports",
        lab=("scene.vibrometer.drop_out=0.2", "scene.vibrometer.drop_out_reported=false"),
        long=True),
    Row("mostly drop-outs", r"the light drops out in \d+ of 540 pixels; focus the beam" + ".*"
        + AGAIN, lab=("scene.vibrometer.drop_out=0.6",), long=True),
    Row("shutter closed", "no light comes back from 540 of 540 pixels; the laser's shutter is "
        "closed" + ".*" + AGAIN, lab=("scene.shutter_open=false",)),
    Row("shutter closed, not reported", "nothing moves at any of the 4 rough centres .* or no "
        "light comes back",
        lab=("scene.shutter_open=false", "scene.vibrometer.drop_out_reported=false"), long=True),
    # Where the beam goes.
    Row("object out of view", "nothing moves at any of the 4 rough centres .*: the calibration "
        "object is out of view", settings=(BESIDE,)),
    Row("object out of view, nothing behind", "no light comes back from 540 of 540 pixels; .* or "
        "the beam falls beside everything", lab=("scene.backdrop=false",), settings=(BESIDE,),
        long=True),
    Row("one rough centre beside its circle", r"the circle around DAC steps \(748, -446\): nothing "
        "moves there .*, while 3 of 4 circles move; .* or the rough centre lies beside the circle",
        settings=(f"scan.views.1.dac=[{ROUGH},[748,-446]]",), long=True),
    Row("one speaker dead", r"the circle around DAC steps \(673, -1632\): nothing moves there .*, "
        "while 3 of 4 circles move; its speaker is dead",
        lab=("scene.speakers={3: {velocity: 0}}",)),
    Row("no speaker driven", "nothing moves at any of the 4 rough centres .* its speakers are not "
        "driven", lab=("scene.speaker.velocity=0",), long=True),
    Row("rough centres of another board", "nothing moves at any of the 4 rough centres .*; all "
        "centres lie within 5 % of the range of laser.board=bits_16; are they steps of bits_12",
        settings=("laser=ometron_16bit", f"scan.views.1.dac=[{ROUGH},[748,-646]]")),
    Row("lines too short", r"the circle around DAC steps \(-142, -704\): an ellipse needs 5 edge "
        r"points or more, not \d \(seen: .*\); put the rough centre nearer to .* or give the lines "
        "more pixels or a larger stride", settings=("scan.coarse.pixels=90",), long=True),
    Row("lines within the circle", r"the circle around DAC steps \(-1136, -5632\): everything on "
        "its lines moves, they do not reach its edge; give .* or a larger stride",
        settings=(*FINER_BOARD, "scan.coarse.stride=1"), long=True),
    Row("lines of the usual stride on a finer board", settings=FINER_BOARD, long=True),
    Row("one circle twice", r"the circle around DAC steps \(673, -1632\) and the circle around DAC "
        r"steps \(673, -1620\) are one and the same",
        settings=(f"scan.views.1.dac=[{ROUGH},[673,-1620]]",), long=True),
    Row("a circle left out", "the view 1 has 3 rough centres, but the calibration object has 4 "
        "circles", settings=(f"scan.views.1.dac=[{ROUGH}]",)),
    # Mirrors.
    Row("mirrors exchanged", WIRED + "up_down and left_right exchanged: .* check the cables",
        lab=(SWAPPED,)),
    Row("mirrors exchanged, pose from edges", WIRED + "up_down and left_right exchanged: ",
        lab=(SWAPPED,), settings=("pose=edge",), long=True),
    Row("mirrors exchanged, one inverted", WIRED + "up_down and left_right exchanged and up_down "
        "inverted: ", lab=(SWAPPED, UP_DOWN), long=True),
    Row("up-down inverted", WIRED + "up_down inverted: .* set laser.up_down.gain=-25 ",
        lab=(UP_DOWN,)),
    Row("up-down inverted and told so", lab=(UP_DOWN,), settings=("laser.up_down.gain=-25",),
        socket=True, long=True),
    Row("left-right inverted", WIRED + "left_right inverted: .* set laser.left_right.gain=-25 ",
        lab=(LEFT_RIGHT,), long=True),
    Row("both inverted", WIRED + "both inverted: .* or pose.upright=false if instrument or object",
        lab=(UP_DOWN, LEFT_RIGHT)),
    Row("mirrored object", "as a mirror image seen from behind.* an object that is the mirror "
        "image of the target", lab=("scene.mirrored=true",)),
    Row("mirror gain wrong", lab=("scene.mirrors.up_down.gain=0.02",),
        noted="circles' images fit the object .*; gain_up_down, .2 %, explains that"),
    Row("mirror gain wrong, pose from edges", lab=("scene.mirrors.up_down.gain=0.02",),
        settings=("pose=edge",),
        noted="circles' images fit the object .*; gain_up_down, .2 %, explains that"),
]  # fmt: skip


@functools.cache
def experiment(*settings):
    """What a configuration is made of."""
    return composing.experiment(*SMALL, *settings)


def laboratory(*settings):
    """The virtual lab of some settings."""
    e = experiment(IDEAL, *settings)
    return VirtualLab(e.scene, e.laser, e.target, e.seed)


def pointed(lab):
    """Rough centres as an operator finds them, who moves the beam until it is in the circles."""
    centres = np.rint(lab.true_dac(lab.calibration_object.center)).astype(int)
    beside = np.array([[7, -9], [-6, 3], [8, 8], [-5, -7]])
    return f"scan.views.1.dac={(centres + beside).tolist()}".replace(" ", "")


@pytest.fixture
def profiles(tmp_path):
    """Command profiles that a digitiser of another make, or a mistake, would need."""
    text = (CONF / "profile" / "virtual_lab.yaml").read_text()
    for name, old, new in (
        ("volts", "type: int16 ", "type: float32 "),
        ("exchanged", "channels: [velocity, reference]", "channels: [reference, velocity]"),
    ):
        assert old in text
        (tmp_path / f"{name}.yaml").write_text(text.replace(old, new))


@pytest.mark.one_in(16)
@pytest.mark.usefixtures("profiles")
@pytest.mark.parametrize(
    "row", [pytest.param(r, id=str(r), marks=[pytest.mark.long] * r.long) for r in TABLE]
)
def test_fault_ends_in_a_right_result_or_names_its_cause(row, sldvexp):
    where = [pointed(laboratory(*row.lab))] if any("mirror" in s for s in row.lab) else []
    if row.line or row.socket:
        behind, faults = laboratory(*row.lab), [make() for make in row.line]
        with LabServer(behind, faults=faults) as server:
            done = sldvexp(*SMALL, *over(server), *where, *row.settings)
        assert behind.position == (0, 0)
        assert not server.dialect.playing
    else:
        done = sldvexp(*SMALL, IDEAL, *row.lab, *where, *row.settings)
    if row.told:
        assert done.status == 1
        *warnings, sentence = done.err.splitlines()
        assert all(line.startswith("sldvexp: warning: ") for line in warnings)
        assert re.search(row.told, sentence), sentence
        assert sorted(p.name for p in done.folder.glob("*.nc")) == []
        return
    assert done.status == 0, done.err
    pose = done.tree["pose"].isel(view=0)
    told = "\n".join([pose.attrs["notes"], *done.tree["verdict"]["text"].values]).strip()
    if row.noted:
        assert re.search(row.noted, told), told
    else:
        assert told == ""
        require_right(pose, laboratory(*row.lab))


def require_right(pose, lab, view="1"):
    """A pose is the lab's, within its standard errors."""
    rotation, origin = lab.true_pose(view)
    turned = vector_from_rotation(pose["rotation"].values @ rotation.T)
    error = np.hstack([turned, pose["origin"].values - origin])
    assert (np.abs(error) < WITHIN * np.sqrt(np.diag(pose["covariance"].values))).all()


@pytest.mark.whole
def test_what_a_sentence_says_puts_it_right(sldvexp):
    """A cable that is plugged in, what was measured without it deleted, and the run resumed."""
    behind = laboratory()
    electronics = replace(behind.scene.digitizer, reference_gain=0.0)
    behind.scene = replace(behind.scene, digitizer=electronics)
    with LabServer(behind) as server:
        done = sldvexp(*SMALL, *over(server))
        told = re.search(r"not plugged in; then delete (\S+) and resume the run$", done.err.strip())
        assert told, done.err
        shutil.rmtree(told[1])
        behind.scene = laboratory().scene
        again = sldvexp(f"resume={done.folder}")
    assert again.status == 0, again.err
    require_right(done.tree["pose"].isel(view=0), laboratory())


TWO_VIEWS = (
    "scan.views={again: {dac: [[-142,-704],[-401,-1326],[673,-1632],[748,-646]]}}",
    "scene.views={again: {euler: [-1.153, 2.547, 1.913], origin: [0.862, 0.508, 1.553]}}",
)
#: Scan lines of one view.
LINES = 4 * (3 + 8)


@pytest.mark.whole
def test_samples_that_run_backwards_in_one_view_are_noted(sldvexp):
    """Every phase is conjugated there; of the pose it makes nothing."""
    behind = laboratory(TWO_VIEWS[1], "scene.speaker.phase=0.7")
    backwards = f.Backwards("DATA?", times=ALWAYS, after=LINES)
    with LabServer(behind, faults=[backwards]) as server:
        done = sldvexp(*SMALL, *over(server), TWO_VIEWS[0])
    pose = done.tree["pose"]
    (note,) = pose.attrs["notes"].splitlines()
    told = (
        r"^views 1 and again: the speakers' phases differ by 1.4 rad, but by 0.0\d* if one view's"
    )
    assert re.search(told + " are conjugated: in one of the two the samples run backwards", note)
    for k, view in enumerate(("1", "again")):
        require_right(pose.isel(view=k), behind, view)


def over(server):
    """Settings that speak to a server."""
    return (*SOCKET, f"instrument.resource={server.resource}", "~scene")


@pytest.mark.whole
def test_a_server_that_dies_and_comes_back_is_connected_again(sldvexp, monkeypatch):
    """It comes back after it was once called in vain."""
    lab, pauses = laboratory(), []
    with (
        LabServer(laboratory(), faults=[f.ServerDies("DATA?", after=9)]) as server,
        ExitStack() as s,
    ):
        port = int(server.resource.split("::")[2])

        def pause(seconds):
            pauses.append(seconds)
            if len(pauses) == 2:
                s.enter_context(LabServer(lab, port=port))

        monkeypatch.setattr(dialogue, "time", SimpleNamespace(sleep=pause))
        done = sldvexp(*SMALL, *over(server), "instrument.retries=5")
    assert done.status == 0, done.err
    assert pauses == [dialogue.PAUSE, 2 * dialogue.PAUSE]
    require_right(done.tree["pose"].isel(view=0), laboratory())


@pytest.mark.long
def test_a_server_that_stays_away_is_told_and_the_run_resumed(sldvexp):
    with LabServer(laboratory(), faults=[f.ServerDies("DATA?", after=9)]) as server:
        port = int(server.resource.split("::")[2])
        done = sldvexp(*SMALL, *over(server))
    told = rf"lab: {server.resource} cannot be reached: Connection refused \(tried 3 times\)"
    assert done.status == 1
    assert re.search(told + ".*" + KEPT, done.err.strip()), done.err
    with LabServer(laboratory(), port=port):
        again = sldvexp(f"resume={done.folder}")
    assert again.status == 0, again.err
    whole = sldvexp(*SMALL).tree
    for name, values in whole["edge/1"].data_vars.items():
        np.testing.assert_array_equal(values, done.tree["edge/1"][name], err_msg=name)
    require_right(done.tree["pose"].isel(view=0), laboratory())
