"""The acceptance test of every scan: estimated, kept, cut off, replayed and sent over a socket."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.instrument import Replay
from sldvexp.instrument.recording import JOURNAL, read_line
from sldvexp.instrument.visa import Visa
from sldvexp.progress import span
from sldvexp.scan.pixel_list import LINE
from sldvexp.session.session import KINDS, estimate, scan_views
from sldvexp.virtual_lab import LabServer, VirtualLab

pytestmark = pytest.mark.usefixtures("client_clock")

CENTRES = (
    "{a: {dac: [[-365, 1314], [-525, 595], [581, 323], [557, 1437]]},"
    " b: {dac: [[-374, 1350], [-550, 613], [586, 323], [583, 1434]]}}"
)
CORNERS = (
    "{a: {corners: [[-640, 140], [-640, -1440], [660, -1440], [660, 140]]},"
    " b: {corners: [[-600, 100], [600, 100], [600, -1300], [-600, -1300]]}}"
)
LIST = str([[-600 + 8 * k, -10 * k] for k in range(130)])


def circles(key: str = "scan") -> list[str]:
    views = f"{key}.views={CENTRES}"
    return [views, f"{key}.coarse.pixels=150", f"{key}.fine.lines=8", f"{key}.sampling.samples=64"]


SCANS = {
    "calibration": ["scan=calibration", *circles()],
    "rectangle": ["scan=rectangle", f"scan.views={CORNERS}", "scan.pixels=[6,9]"],
    "stride": ["scan=rectangle", f"scan.views={CORNERS}", "scan.stride=199"],
    "list": ["scan=list", f"scan.views={{a: {{dac: {LIST}}}, b: {{dac: {2 * LINE * [[1, 2]]}}}}}"],
    "session": [
        "scan=session",
        *circles("scan.calibration"),
        f"scan.structure.views={CORNERS}",
        "scan.structure.pixels=[5,8]",
        "scan.structure.sampling={samples: 300, frequency: [197, 439]}",
    ],
    "session of lists": [
        "scan=session",
        "scan.structure.views={a: {corners: [[0, 0], [90, 0], [90, -80], [0, -80]]}}",
        "scan.structure.stride=20",
        f"scan.pixels.views={{b: {{dac: {LIST}}}}}",
    ],
}


def lines_of(folder):
    return {p.relative_to(folder): p for p in sorted((folder / JOURNAL).rglob("*.npz"))}


def require_same(one, two):
    assert one.keys() == two.keys()
    for name, group in one.items():
        assert group.identical(two[name]), name


@pytest.mark.whole
@pytest.mark.parametrize("name", SCANS)
def test_every_scan(name, composed, tmp_path, capsys):
    experiment = composed(*SCANS[name])
    scan = experiment.scan
    first = tmp_path / "first"
    found = scan_views(experiment, first / JOURNAL)
    told = capsys.readouterr().out.strip()
    assert told == estimate(scan)
    assert_announced(scan, first, told)
    assert_described(scan, found)
    kept = lines_of(first)

    # A recording gives the same, also when every line comes from it.
    replayed = replace(experiment, instrument=Replay(str(first)), scene=None)
    require_same(scan_views(replayed, tmp_path / "replayed" / JOURNAL), found)

    # So does the socket.
    given = (experiment.scene, experiment.laser, experiment.target, experiment.seed)
    with LabServer(VirtualLab(*given)) as server:
        sent = replace(experiment, instrument=Visa(server.resource))
        require_same(scan_views(sent, tmp_path / "sent" / JOURNAL), found)
        assert server.dialect.lab.position == (0, 0)

    # What was cut off goes on: only what is missing is measured.
    lost = list(kept.values())[len(kept) // 3 :: 2]
    for path in lost:
        path.unlink()
    before = {p: p.stat().st_mtime_ns for p in kept.values() if p.exists()}
    require_same(scan_views(experiment, first / JOURNAL), found)
    assert lines_of(first).keys() == kept.keys()
    assert {p: p.stat().st_mtime_ns for p in before} == before


def assert_announced(scan, folder, told):
    """The session has scanned exactly the pixels that it had announced, for as long."""
    pixels, seconds = 0, 0.0
    for path in lines_of(folder).values():
        dac, _, samples = read_line(path)
        pixels += len(dac)
        seconds += samples.counts.shape[0] * samples.counts.shape[2] / samples.rate
    parts = [(part, view) for view in scan.view_names() for part in scan.parts(view)]
    assert pixels == sum(part.pixel_count(view) for part, view in parts)
    assert f"{pixels} pixels in 2 views, {span(seconds)} of samples" in told


def assert_described(scan, found):
    """Every part of every view gave a group, all of whose variables the program knows."""
    for view in scan.view_names():
        kinds = [part.kind for part in scan.parts(view)]
        assert len(set(kinds)) == len(kinds)
        assert set(kinds) <= set(KINDS)
    assert len(found) == sum(len(scan.parts(view)) for view in scan.view_names())
    for name, group in found.items():
        kind, _, view = name.partition("/")
        assert view in scan.view_names()
        for variable, values in group.data_vars.items():
            known = dataset.VARIABLES[kind][variable]
            assert values.dims == tuple(d.strip("[]") for d in known.dims.split())
            assert values.attrs["units"] == known.units
            assert np.isfinite(values.values).all()


@pytest.mark.whole
def test_a_session_with_a_broadband_structure_is_the_same_over_a_socket(composed, tmp_path):
    """The circles of the second view follow the averaged records of the first."""
    experiment = composed(
        "scan=session",
        *circles("scan.calibration"),
        f"scan.structure.views={CORNERS}",
        "scan.structure.pixels=[3,4]",
        "scan.structure.sampling={excitation: multisine, band: [50, 1325], rate: 5120.0, "
        "samples: 512, records: 4}",
        "scene.digitizer.reference_range=10",
        "signal=response",
    )
    found = scan_views(experiment, tmp_path / "here")
    given = (experiment.scene, experiment.laser, experiment.target, experiment.seed)
    with LabServer(VirtualLab(*given)) as server:
        sent = replace(experiment, instrument=Visa(server.resource))
        require_same(scan_views(sent, tmp_path / "sent"), found)


@pytest.mark.whole
def test_both_parts_of_a_view_are_what_they_are_alone(composed, tmp_path):
    """But for the noise, which another scan line has."""
    session = composed(*SCANS["session"])
    both = scan_views(session, tmp_path / "both")
    edges = scan_views(composed(*SCANS["calibration"]), tmp_path / "edges")
    image = scan_views(replace(session, scan=session.scan.structure), tmp_path / "image")
    for view in "ab":
        assert both[f"edge/{view}"].identical(edges[f"edge/{view}"])
        one, two = both[f"image/{view}"], image[f"image/{view}"]
        np.testing.assert_array_equal(one["dac"], two["dac"])
        apart = np.abs(one["velocity"] - two["velocity"]) / np.hypot(
            one["velocity_std"], two["velocity_std"]
        )
        # 80 pixels and frequencies, of two normal parts each: one in 1e6 exceeds 6.
        assert 0.5 < float(apart.median()) < float(apart.max()) < 6


@pytest.mark.whole
def test_the_instrument_is_opened_once_a_view(composed, tmp_path, monkeypatch):
    experiment = composed(*SCANS["session"])
    opened, plugin = [], type(experiment.instrument)
    open_ = plugin.open

    def counted(*args, **more):
        opened.append(more["view"])
        return open_(*args, **more)

    monkeypatch.setattr(plugin, "open", counted)
    scan_views(experiment, tmp_path)
    assert opened == ["a", "b"]
    # A view that was scanned to the end is not gone to again.
    next((tmp_path / "b").glob("image_*")).unlink()
    scan_views(experiment, tmp_path)
    assert opened == ["a", "b", "b"]
