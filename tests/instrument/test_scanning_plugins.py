"""The acceptance test of every instrument that scans: all measure what the virtual lab measures."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.instrument import Acquisition, InstrumentError
from sldvexp.virtual_lab import LabServer, VirtualLab

pytestmark = pytest.mark.usefixtures("client_clock")

ACQUISITION = Acquisition(12345.678901234567, 200, (450.1, 0.1 + 0.2), 0.7)


@pytest.fixture(params=["simulated", "visa"])
def scanning(request, experiment):
    """Open the instrument of a configuration, and tell which virtual lab is behind it."""
    servers = []

    def opened(made, view=""):
        given = (made.scene, made.laser, made.target, made.seed)
        if request.param == "simulated":
            ours = experiment("instrument=simulated").instrument.open(*given, view=view)
            return ours, ours
        servers.append(LabServer(VirtualLab(*given)).__enter__())
        setting = f"instrument.resource={servers[-1].resource}"
        plugin = experiment("instrument=visa", setting).instrument
        return plugin.open(*given, view=view), servers[-1].dialect.lab

    yield opened
    for server in servers:
        server.__exit__()


@pytest.mark.one_in(6)
@pytest.mark.parametrize(
    "chosen",
    [
        (),
        ("laser=ometron_16bit", "seed=7"),
        ("scene=plate", "target=two_planes", "scene.vibrometer.drop_out=0.3"),
        ("scene.digitizer.velocity_range=0.5", "scene.digitizer.reference_range=0.3"),
    ],
)
def test_scans_are_those_of_the_lab(scanning, experiment, lab, same, chosen):
    made, reference = experiment(*chosen), lab(*chosen)
    view = list(made.scene.views)[-1]
    reference.use_view(view)
    reference.configure(ACQUISITION)
    lines = np.random.default_rng(0).integers(-700, 700, (3, 90, 2))
    with scanning(made, view)[0] as ours:
        ours.configure(ACQUISITION)
        for stream in (2, 0, 2**40):
            for dac in lines:
                assert same(ours.scan(dac, stream=stream), reference.scan(dac, stream=stream))
        assert same(ours.scan(lines[0]), reference.scan(lines[0]))
        for dac in lines[1][:5]:
            for one in (ours, reference):
                one.move(dac.tolist())
            assert same(ours.acquire(), reference.acquire())
        assert same(ours.scan(lines[0][:0]), reference.scan(lines[0][:0]))


@pytest.mark.one_in(3)
@pytest.mark.parametrize("leaves", [None, ZeroDivisionError, KeyboardInterrupt, InstrumentError])
def test_whoever_leaves_the_mirrors_are_home_and_the_generator_off(scanning, experiment, leaves):
    made = experiment("scene.vibrometer.noise=0", "scene.digitizer.reference_noise=0")
    opened, behind = scanning(made)
    left = pytest.raises(leaves, match=r"^why$") if leaves else nullcontext()
    with left, opened as ours:
        ours.configure(ACQUISITION)
        ours.move([300, -300])
        assert behind.position == (300, -300)
        assert np.abs(ours.acquire().counts[:, 1]).max() > 1000
        if leaves:
            raise leaves("why")
    assert behind.position == (0, 0)
    assert (behind.acquire().counts[:, 1] == 0).all()


def test_what_the_board_cannot_do_is_refused(scanning, experiment):
    with scanning(experiment())[0] as ours:
        with pytest.raises(InstrumentError, match=r"not configured; call configure first"):
            ours.scan(np.zeros((2, 2), int))
        ours.configure(ACQUISITION)
        refused = r"pixel 1 asks for left_right step 5000, but the board has -4096 to 4096"
        with pytest.raises(InstrumentError, match=refused):
            ours.scan(np.array([[0, 0], [0, 5000]]))
        with pytest.raises(InstrumentError, match=r"up_down step -4097"):
            ours.move([-4097, 0])
        with pytest.raises(InstrumentError, match=r"configur.*rate and samples must be positive"):
            ours.configure(Acquisition(0.0, 256, ()))
        with pytest.raises(InstrumentError, match=r"frequencies must be positive"):
            ours.configure(Acquisition(1.0, 256, (-1.0,)))


def test_a_view_that_is_not_there(scanning, experiment):
    told = pytest.raises((InstrumentError, UserError), match=r"no view 9; Valid: 1, 2")
    with told, scanning(experiment("scene=plate"), "9")[0]:
        pass


def test_a_simulation_needs_a_scene(experiment):
    made = experiment("instrument=simulated")
    with pytest.raises(UserError, match="needs a scene; choose scene=calibration or plate"):
        made.instrument.open(None, made.laser)
    assert made.instrument.inputs() == []
    assert made.instrument.takes_views_itself
