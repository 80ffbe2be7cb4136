"""References of functions in universal files: which one it is, and in which unit."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import take_findings
from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView
from sldvexp.importers.uff import UffImport

from .plate_files import FIRST, POINTS, SAID, SIX_DIGITS, read, refused


def test_roving_references_are_asked_about(uff, tmp_path):
    path = tmp_path / "a.uff"
    functions = [
        uff.function(n, FIRST, first=100.0, step=10.0, reference=(20 + n, 3)) for n in (1, 2)
    ]
    path.write_bytes(uff.units() + uff.nodes(POINTS[:2]) + b"".join(functions))
    refused(path, "is of the reference 22+Z, data set 3 of 21+Z", "or say any")
    np.testing.assert_allclose(read(path, reference_dof="any")["velocity"][0, 1], FIRST, rtol=1e-5)


def views_of_references(uff, tmp_path, references):
    views = {}
    for name, reference in references.items():
        path = tmp_path / f"{name}.uff"
        function = uff.function(1, FIRST, reference=(reference, 3))
        path.write_bytes(uff.units() + uff.nodes(POINTS) + function)
        views[name] = PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0])
    return views


def test_views_of_several_references_are_asked_about(uff, tmp_path):
    views = views_of_references(uff, tmp_path, {"a": 1, "b": 1, "c": 7})
    with pytest.raises(UserError, match=r"several references: 1\+Z \(a, b\), 7\+Z \(c\)") as error:
        UffImport(views=views, **SAID).read()
    assert "instrument.reference_dof=any if one excitation" in str(error.value)
    group = UffImport(views=views, **SAID, reference_dof="any").read()
    assert not take_findings({"line_of_sight": group})
    views = views_of_references(uff, tmp_path, {"a": 1, "b": 1})
    assert UffImport(views=views, **SAID).read().sizes["view"] == 2


def test_any_cannot_choose_among_references_of_one_node(uff, tmp_path):
    path = tmp_path / "several.uff"
    functions = uff.function(1, FIRST) + uff.function(1, 2 * FIRST, reference=(7, 1))
    path.write_bytes(uff.units() + uff.nodes(POINTS) + functions)
    asked = "choose one of 1+Z, 7+X with instrument.reference_dof=1+Z"
    others = "and for modes of all the others with instrument.further_references"
    assert refused(path, "the same node 1", asked).endswith(f"{asked}, {others}")
    refused(path, f"{asked}, as any cannot choose among", reference_dof="any")
    group = read(path, reference_dof="7+X")
    np.testing.assert_allclose(group["velocity"][0, 0], 2 * FIRST, rtol=SIX_DIGITS)


LBF = 4.4482216152605
#: Unit of length and force of data set 164, labels of values and reference, and the reference's
#: unit in N: of files that are to be in lbf.
IN_POUNDS = {
    "labels": (1.0, 1.0, "in/s", "lbf"),
    "label of values": (1.0, 1.0, "in/s/lbf", ""),
    "data set 164": (0.0254, LBF, "", ""),
}


def views_of_units(uff, tmp_path, length, force, unit, reference_unit):
    """Two views of the same motion, ``2 N * FIRST``, of functions per N and in inches per lbf."""
    labels = {"unit": unit, "reference_unit": reference_unit}
    contents = {
        "a": uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST),
        "b": uff.units(length, force=force)
        + uff.nodes(np.array(POINTS) / length)
        + uff.function(1, FIRST / 0.0254 * LBF, **labels),
    }
    views = {}
    for name, content in contents.items():
        path = tmp_path / f"{name}.uff"
        path.write_bytes(content)
        views[name] = PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0])
    return views


@pytest.mark.parametrize("name", IN_POUNDS)
def test_references_in_several_units_are_converted_or_asked_about(uff, tmp_path, name):
    views = views_of_units(uff, tmp_path, *IN_POUNDS[name])
    with pytest.raises(UserError, match=r"are in N \(a\), lbf \(b\); say in which unit") as error:
        UffImport(views=views, **SAID | {"reference": 2.0}).read()
    assert str(error.value).endswith("instrument.reference='2.0 N'")
    for reference in ("2 N", "2000 mN", f"{2 / LBF:.12g} lbf"):
        group = UffImport(views=views, **SAID | {"reference": reference}).read()
        np.testing.assert_allclose(group["velocity"][:, 0], [2 * FIRST] * 2, rtol=SIX_DIGITS)
        # A note says that values are in inches although data set 164 states m.
        found = take_findings({"line_of_sight": group})
        assert {f.severity.name for f in found} <= {"note"}
    assert group.attrs["import_reference"] == "2 N; 0.449618 lbf"


def test_reference_whose_unit_is_not_known_is_doubtful(uff, tmp_path):
    views = views_of_units(uff, tmp_path, 1.0, 1.0, "m/s", "EU")
    (finding,) = take_findings({"line_of_sight": UffImport(views=views, **SAID).read()})
    assert "are N (a), EU (b)" in finding.text
    assert finding.severity.name == "doubtful"


def test_unit_of_a_setting_that_no_file_confirms_is_doubtful(uff, tmp_path):
    path = tmp_path / "a.uff"
    path.write_bytes(uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST, reference_unit="EU"))
    assert not take_findings({"line_of_sight": read(path, reference=2.0)})
    (finding,) = take_findings({"line_of_sight": read(path, reference="2 N")})
    assert "are EU (a); where that is not known, the number of" in finding.text
    assert finding.remedy == "instrument.reference=2"
    assert finding.severity.name == "doubtful"


def test_reference_of_another_quantity_or_several_units_is_refused(uff, tmp_path):
    path = tmp_path / "a.uff"
    nodes = uff.units() + uff.nodes(POINTS)
    path.write_bytes(nodes + uff.function(1, FIRST))
    refused(path, "a reference in N, a force", "is in V, a voltage", reference="2 V")
    for wrong in ("2 EU", "N", "-2 N", 0.0, "nan"):
        with pytest.raises(UserError, match="reference: "):
            read(path, reference=wrong)
    other = uff.function(2, FIRST, reference_unit="lbf")
    path.write_bytes(nodes + uff.function(1, FIRST) + other)
    refused(path, "has a reference in lbf, data set 3 in N", "different files")
