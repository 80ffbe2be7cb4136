"""Response functions of cross and auto spectra, and velocities of values at nodes (data set 55)."""

from __future__ import annotations

import numpy as np
import pytest
import pyuff

from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView
from sldvexp.importers import conventions as settings
from sldvexp.importers.uff import Estimator, FunctionKind, NodalAxes, UffImport
from sldvexp.units import LengthUnit

POINTS = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0.01]])
FREQUENCY = np.array([10.0, 20.0, 30.0, 40.0])
RNG = np.random.default_rng(11)
#: Response functions of three nodes, m/s per N, and the spectra that an analyser has of them.
H = 1e-3 * (RNG.normal(size=(3, 4)) + 1j * RNG.normal(size=(3, 4)))
G_FF = np.array([2.0, 3.0, 0.5, 7.0])
COHERENCE = np.array([0.9, 0.5, 0.99, 1.0])
#: With noise in the responses H1 is right, with noise in the reference H2.
G_XF = H * G_FF
G_XX = np.abs(H) ** 2 * G_FF / COHERENCE
COMMON = {
    "positive": settings.Positive.towards,
    "phase": settings.Phase.exp_plus,
    "reference": 1.0,
    "length_unit": LengthUnit.m,
    "directions": settings.Directions.view,
}


@pytest.fixture
def read(tmp_path):
    def read_(content, dof="", **more):
        path = tmp_path / "a.uff"
        path.write_bytes(content)
        more = {**COMMON, **more}
        far = [] if more["directions"] is settings.Directions.dof else [0.0, 0.0, 1.0]
        views = {"a": PointwiseView(path=str(path), direction=far, dof=dof)}
        return UffImport(views=views, **more).read()

    return read_


@pytest.fixture
def refused(read):
    def refused_(content, said, **more):
        with pytest.raises(UserError) as error:
            read(content, **more)
        assert said in str(error.value), str(error.value)
        assert "\n" not in str(error.value)

    return refused_


@pytest.fixture
def spectra(uff):
    """Cross spectra against 99+Z and the auto spectra, some left out."""

    def made(cross=G_XF, responses=G_XX, references=(G_FF,), of_reference="N^2", **more):
        even = {"first": 10.0, "step": 10.0, "direction": 3}
        more = {"unit": "m/s*N", **more}
        content = uff.nodes(POINTS)
        for n, row in enumerate(cross, 1):
            content += uff.function(n, row, kind=3, type_=6, reference=(99, 3), **even, **more)
        for n, row in enumerate(responses, 1):
            content += uff.function(n, row, kind=2, type_=4, unit="(m/s)^2", **even)
        for row in references:
            auto = {"kind": 2, "type_": 4, "quantity": 13, "unit": of_reference}
            content += uff.function(99, row, **auto, **even)
        return content

    return made


def test_both_estimators(read, spectra):
    group = read(spectra(), estimator=Estimator.h1, reference=2.0)
    np.testing.assert_allclose(group["velocity"][0], 2 * H, rtol=1e-10)
    assert group.attrs["import_function"] == "cross spectrum"
    assert group.attrs["import_estimator"] == "h1"
    assert group.attrs["import_quantity"] == "velocity"
    assert "velocity_std" not in group
    group = read(spectra(), estimator=Estimator.h2)
    np.testing.assert_allclose(group["velocity"][0], H / COHERENCE, rtol=1e-10)


def test_noise_in_both_with_its_ratio(read, spectra):
    noise, ratio = 0.1 * G_FF, 3e-7
    made = spectra(responses=np.abs(H) ** 2 * G_FF + ratio * noise, references=(G_FF + noise,))
    group = read(made, estimator=Estimator.hv, noise_ratio=ratio)
    np.testing.assert_allclose(group["velocity"][0], H, rtol=1e-9)
    assert group.attrs["import_estimator"] == "hv"
    h1 = read(made, estimator=Estimator.h1)
    np.testing.assert_allclose(h1["velocity"][0], H / 1.1, rtol=1e-10)


def test_response_functions_come_before_the_spectra_they_are_made_of(read, spectra, uff):
    even = {"first": 10.0, "step": 10.0, "type_": 6, "unit": "m/s"}
    content = spectra() + b"".join(uff.function(n, 3 * row, **even) for n, row in enumerate(H, 1))
    np.testing.assert_allclose(read(content)["velocity"][0], 3 * H, rtol=1e-10)
    group = read(content, function=FunctionKind.cross, estimator=Estimator.h1)
    np.testing.assert_allclose(group["velocity"][0], H, rtol=1e-10)


def test_phase_and_chosen_lines(read, spectra):
    more = {"estimator": Estimator.h1, "frequency": [40.0, 20.0]}
    group = read(spectra(cross=G_XF.conj()), phase=settings.Phase.exp_minus, **more)
    np.testing.assert_allclose(group["velocity"][0], H[:, [3, 1]], rtol=1e-10)


def test_errors_of_the_spectra_themselves(read, spectra):
    group = read(spectra(), estimator=Estimator.h1, averages=8)
    expected = np.abs(H) * np.sqrt((1 - COHERENCE) / (14 * COHERENCE))
    np.testing.assert_allclose(group["velocity_std"][0][:, :3], expected[:, :3], rtol=1e-9)
    # Of a coherence of 1 there is rounding left.
    assert (group["velocity_std"][0][:, 3] < 1e-5 * np.abs(H[:, 3])).all()


UNITS = {
    "(mm/s)*N": 1e-3,
    "N*m/s": 1.0,
    "[(µm/s)·V/Hz]": 1e-6,
    "in/s N": 0.0254,
}


@pytest.mark.parametrize("unit", UNITS)
def test_units_of_products(read, spectra, unit):
    of_reference = "V²/Hz" if unit.endswith("Hz]") else "N^2"
    content = spectra(unit=unit, responses=(), of_reference=of_reference)
    group = read(content, estimator=Estimator.h1)
    np.testing.assert_allclose(group["velocity"][0], UNITS[unit] * H, rtol=1e-10)


SPECTRA_REFUSED = {
    "estimator": ({}, "say it with instrument.estimator=h1", {"estimator": None}),
    "phase": ({}, "the response and the conjugate reference is exp_plus", {"phase": None}),
    "reference": ({}, "say it with instrument.reference", {"reference": None}),
    "no auto spectrum of the reference": (
        {"references": ()},
        "data set 2 (58), line 12: needs one auto spectrum of its reference 99+Z",
        {},
    ),
    "two": ({"references": (G_FF, G_FF)}, "for H1 or the coherence; there are 2", {}),
    "none of a response": (
        {"responses": G_XX[:2]},
        "data set 4 (58), line 44: needs one auto spectrum of its response 3+Z",
        {"estimator": Estimator.h2},
    ),
    "zero at a line": (
        {"references": (G_FF * [1, 0, 1, 1],)},
        "but at 20 Hz it is 0; choose other lines with instrument.frequency",
        {},
    ),
    "other lines": ({"references": (G_FF[:2],)}, "has other frequencies than data set 2", {}),
    "other scales": ({"unit": "(m/s)*N/Hz"}, "both must be powers, or both power densities", {}),
    "reference in another unit": (
        {"of_reference": "mN^2"},
        "is in m/s*N, its auto spectrum in mN^2; the reference must be in one unit in both",
        {},
    ),
    "response in another unit": (
        {"unit": "(mm/s)*N"},
        "its auto spectrum in (m/s)^2; the response must be in one unit in both",
        {"estimator": Estimator.h2},
    ),
    "both auto spectra for both noises": (
        {"references": ()},
        "needs one auto spectrum of its reference 99+Z",
        {"estimator": Estimator.hv},
    ),
    "coherence": (
        {"responses": G_XX / 2},
        "with the auto spectra its coherence is 1 to 2",
        {"averages": 4},
    ),
    "unit of two": ({"unit": "m/s*mm/s"}, "say it with instrument.unit", {}),
    "unit that is no factor": ({"unit": "m*s*N"}, "say it with instrument.unit", {}),
}


@pytest.mark.parametrize("name", SPECTRA_REFUSED)
def test_spectra_that_are_refused(refused, spectra, name):
    written, said, more = SPECTRA_REFUSED[name]
    refused(spectra(**written), said, **{"estimator": Estimator.h1, **more})


# Values at nodes.

V = 1e-3 * (RNG.normal(size=(3, 3, 4)) + 1j * RNG.normal(size=(3, 3, 4)))  # node, axis, frequency
NODAL = {"reference": None, "amplitude": settings.Amplitude.peak}
DOF = NODAL | {"directions": settings.Directions.dof, "positive": None}


@pytest.fixture
def nodal(uff):
    """A file of data sets 55, one a frequency."""

    def made(
        values=V,
        frequency=FREQUENCY,
        analysis=5,
        quantity=11,
        words="ODS",
        first=1,
        geometry=True,
        **more,
    ):
        content = uff.nodes(POINTS, **more) if geometry else b""
        for k, f in enumerate(frequency):
            one = values[..., k]
            type_ = 5 if np.iscomplexobj(one) else 2
            kinds = (1, analysis, {1: 1, 3: 2, 6: 3}[one.shape[1]], quantity, type_, one.shape[1])
            second = {5: (2, 1, 1, k + 1), 2: (2, 4, 1, k + 1)}[analysis]
            reals = [f] if analysis == 5 else [f, 1.0, 0.0, 0.0]
            lines = [
                words,
                "",
                "",
                "",
                "",
                *("".join(f"{n:10d}" for n in r) for r in (kinds, second)),
            ]
            lines.append("".join(f"{v:13.5E}" for v in reals))
            for n, row in enumerate(one, first):
                flat = np.ascontiguousarray(row).view(float)
                lines.append(f"{n:10d}")
                lines += [
                    "".join(f"{v:13.5E}" for v in flat[i : i + 6]) for i in range(0, len(flat), 6)
                ]
            content += uff.data_set(55, *lines)
        return content

    return made


METRES = {"unit": settings.MotionUnit.m}


def test_components_of_nodal_values(read, nodal):
    order = [2, 0, 3, 1]
    content = nodal(V[..., order], FREQUENCY[order])
    for i, dof in enumerate(("+X", "+Y", "+Z")):
        more = DOF | METRES
        group = read(content, dof, **more)
        np.testing.assert_allclose(group["velocity"][0], V[:, i], rtol=1e-5)
        np.testing.assert_array_equal(group["direction_cosines"][0], [np.eye(3)[i]] * 3)
        np.testing.assert_allclose(group["frequency"], FREQUENCY)
    assert group.attrs["import_function"] == "nodal values (data sets 55, 2414)"


def test_scalars_along_a_view(read, nodal):
    group = read(nodal(-V[:, 2:].real), **NODAL, **METRES, frequency=[20.0])
    np.testing.assert_allclose(group["velocity"][0][:, 0], -V[:, 2, 1].real, rtol=1e-5)


def test_columns_that_touch(read, nodal):
    small = V.copy()
    small[1] = -1.5e-100 * (1 + 1j)
    content = nodal(small)
    assert b"E-100-1.5" in content
    group = read(content, "+Y", **NODAL, **METRES)
    np.testing.assert_allclose(group["velocity"][0], small[:, 1], rtol=1e-5)


def test_nodal_values_that_another_program_wrote(tmp_path):
    path = tmp_path / "a.uff"
    common = {"type": 55, "analysis_type": 5, "data_ch": 2, "spec_data_type": 11, "load_case": 1}
    columns = [f"r{i}" for i in (1, 2, 3)]
    pyuff.UFF(str(path)).write_sets(
        [
            {
                **common,
                **{f"id{i}": "ODS" for i in range(1, 6)},
                "model_type": 1,
                "freq_step_n": k + 1,
                "freq": f,
                "node_nums": [1, 2, 3],
                **dict(zip(columns, V[..., k].T, strict=True)),
            }
            for k, f in enumerate(FREQUENCY)
        ],
        "overwrite",
    )
    views = {"a": PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0], dof="+Z")}
    group = UffImport(views=views, **{**COMMON, **NODAL, **METRES}).read()
    np.testing.assert_allclose(group["velocity"][0], V[:, 2], rtol=1e-5)


def test_functions_come_before_nodal_values(read, nodal, uff):
    even = {"first": 10.0, "step": 10.0, "kind": 12, "type_": 6, "unit": "m/s"}
    content = nodal() + b"".join(uff.function(n, row, **even) for n, row in enumerate(H, 1))
    np.testing.assert_allclose(read(content, **NODAL)["velocity"][0], H, rtol=1e-10)
    group = read(content, "+Y", **NODAL, **METRES, function=FunctionKind.nodal)
    np.testing.assert_allclose(group["velocity"][0], V[:, 1], rtol=1e-5)


def test_nodal_values_of_several_kinds(read, nodal, refused):
    content = nodal() + nodal(np.abs(V), words="standard error", geometry=False)
    said = "are both of 10 Hz; choose one with instrument.containing"
    refused(content, said, dof="+X", **NODAL, **METRES)
    group = read(content, "+X", **NODAL, **METRES, containing="ODS")
    np.testing.assert_allclose(group["velocity"][0], V[:, 0], rtol=1e-5)
    # A mode beside the response is no matter if it is not asked for.
    content = nodal() + nodal(V.real, analysis=2, words="mode", geometry=False)
    read(content, "+X", **NODAL, **METRES, containing="ODS")


def cut(content, at):
    lines = content.split(b"\n")
    return b"\n".join(line for i, line in enumerate(lines, 1) if i != at)


NODAL_REFUSED = {
    "mode": (
        lambda made: made(V.real, analysis=2),
        "data set 2 (55), line 17: these values are of a normal mode, not amplitudes at a freq",
        {},
    ),
    "all directions": (
        lambda made: made(),
        "has values of node 1 in several directions (1+X, 1+Y); choose one",
        {},
    ),
    "turns": (
        lambda made: made(np.repeat(V, 2, axis=1)),
        "has values of node 1 in several directions (1+X, 1+Y); choose one",
        {},
    ),
    "amplitude": (lambda made: made(), "say it with instrument.amplitude", {"amplitude": None}),
    "unit": (lambda made: made(), "say it with instrument.unit", {"unit": None}),
    "quantity": (lambda made: made(quantity=0), "say it with instrument.quantity", {}),
    "averages": (lambda made: made(), "has no coherence of node 1", {"averages": 2}),
    "other nodes": (
        lambda made: made() + made(frequency=[50.0], first=2, geometry=False),
        "has other nodes, directions or another quantity than data set 5",
        {},
    ),
    "a value less": (
        lambda made: cut(made(), 21),
        "line 21: the values of a node must be 6 numbers in columns of 13, not '         2'",
        {},
    ),
    "twice": (
        lambda made: made().replace(b"\n         2\n", b"\n         1\n"),
        "the node 1 has values twice",
        {},
    ),
    "no values": (
        lambda made: made(V[:0]),
        "data set 2 (55), line 19: has no values",
        {},
    ),
    "four directions": (
        lambda made: made().replace(b"         5         3\n", b"         5         4\n", 1),
        "of 1, 3 or 6 directions, not of type 5 and 4 directions",
        {},
    ),
}


@pytest.mark.parametrize("name", NODAL_REFUSED)
def test_nodal_values_that_are_refused(refused, nodal, name):
    made, said, more = NODAL_REFUSED[name]
    dof = "" if name in ("all directions", "turns") else "+X"
    refused(made(nodal), said, dof=dof, **{**NODAL, **METRES, **more})


def test_nodal_directions_of_nodes_with_own_systems(refused, nodal, uff, read):
    turned = uff.systems({5: ([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], [0, 0, 0])})
    content = turned + nodal(motion=5)
    refused(content, "say which with instrument.nodal_axes", dof="+X", **DOF | METRES)
    for axes, expected in ((NodalAxes.node, [0, 1, 0]), (NodalAxes.world, [1, 0, 0])):
        group = read(content, "+X", **DOF, **METRES, nodal_axes=axes)
        np.testing.assert_array_equal(group["direction_cosines"][0], [expected] * 3)
        np.testing.assert_allclose(group["velocity"][0], V[:, 0], rtol=1e-5)
    np.testing.assert_allclose(
        read(content, "+X", **NODAL, **METRES)["velocity"][0], V[:, 0], rtol=1e-5
    )
