"""Models come from files of other programs, and what is wrong with them is said in a sentence."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from sldvexp.dataset import Severity, group
from sldvexp.errors import ConfigError, UserError
from sldvexp.io.uff import writer
from sldvexp.models import MatchedPoint, ModelFile, ModelFrame, universal_text
from sldvexp.models.estimate import examine_model
from sldvexp.models.placing import check_place
from sldvexp.models.wording import findings_about
from sldvexp.units import LengthUnit
from sldvexp.volume import Grid
from tests.models.made_models import (
    CENTER,
    LASER,
    THICKNESS,
    A,
    Measured,
    aimed,
    closed_form,
    true_plate,
    true_poses,
)


@pytest.fixture(scope="module")
def tree():
    return Measured(true_plate(), views=2, shape=(17, 19)).tree(0)


def own_axes(**settings):
    """The model with its axes at the plate's middle."""
    model = closed_form((8, 6), **settings)
    return replace(model, position=model.position - CENTER)


def written(folder: Path, text: str, name="model.uff"):
    path = folder / name
    path.write_text(text)
    return str(path)


def source(path, **settings):
    settings = {"frame": ModelFrame(origin=CENTER.tolist()), "thickness": THICKNESS} | settings
    return ModelFile(path=path, **settings)


@pytest.mark.parametrize("rotations", [True, False])
@pytest.mark.parametrize("triangles", [True, False])
def test_universal_file_is_read_as_it_was_written(tmp_path, rotations, triangles):
    model = own_axes(rotations=rotations, triangles=triangles)
    back = ModelFile(path=written(tmp_path, universal_text(model))).read()
    np.testing.assert_allclose(back.position, model.position, atol=1e-12)
    np.testing.assert_allclose(back.translation, model.translation, atol=1e-6)
    np.testing.assert_allclose(back.frequency, model.frequency, rtol=1e-5)
    assert (back.rotation is not None) == rotations
    np.testing.assert_array_equal(back.halves, model.halves)


def test_universal_file_in_mm_is_that_in_m(tmp_path, tree):
    model = own_axes()
    large = replace(model, position=1e3 * model.position, translation=1e3 * model.translation)
    text = universal_text(large).split("    -1\n   164")[-1].split("    -1\n", 1)[1]
    path = written(tmp_path, text)
    in_mm = source(path, unit=LengthUnit.mm, thickness=1e3 * THICKNESS).model()
    np.testing.assert_allclose(in_mm.position, model.position + CENTER, atol=1e-9)
    np.testing.assert_allclose(in_mm.translation, model.translation, atol=1e-6)
    np.testing.assert_allclose(in_mm.rotation, model.rotation, atol=1e-3)
    assert in_mm.thickness == pytest.approx(THICKNESS)
    stated = written(tmp_path, universal_text(model))
    with pytest.raises(UserError, match=r"units of 1 m, the configuration model.unit in units of"):
        source(stated, unit=LengthUnit.mm).model()


def test_values_along_axes_of_the_nodes_are_turned(tmp_path):
    """Nodes with displacement systems of their own, as of cylinders."""
    model = own_axes()
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    nodes = len(model.position)
    text = writer.units() + writer.systems(np.broadcast_to(turn, (1, 3, 3)))
    text += writer.nodes(model.position, np.full(nodes, 2))
    text += writer.quadrilaterals(model.quadrilaterals)
    for k, f in enumerate(model.frequency):
        parts = [model.translation[..., k] @ turn.T, model.rotation[..., k] @ turn.T]
        text += writer.normal_mode([""] * 5, np.hstack(parts), float(f), k + 1)
    back = ModelFile(path=written(tmp_path, text)).read()
    np.testing.assert_allclose(back.rotation, model.rotation, atol=2e-4)


def bulk_data(model):
    """The mesh as Nastran's bulk data."""
    nodes = [f"GRID,{k},,{x:.6f},{y:.6f},{z:.6f}" for k, (x, y, z) in enumerate(model.position, 1)]
    shells = [
        f"CQUAD4,{k},1,{a},{b},{c},{d}"
        for k, (a, b, c, d) in enumerate(model.quadrilaterals + 1, 1)
    ]
    return "\n".join(["BEGIN BULK", *nodes, *shells, "ENDDATA", ""])


@pytest.mark.parametrize("suffix", [".vtu", ".bdf"])
def test_meshes_of_other_programs_are_read_with_their_shapes(tmp_path, suffix):
    model = own_axes(rotations=False)
    path = tmp_path / f"model{suffix}"
    if suffix == ".vtu":
        arrays = {
            f"mode {k + 1} ({f:.9g} Hz)": model.translation[..., k]
            for k, f in enumerate(model.frequency)
        }
        meshio.Mesh(model.position, [("quad", model.quadrilaterals)], arrays).write(path)
    else:
        path.write_text(bulk_data(model))
    shapes = None if suffix == ".vtu" else written(tmp_path, universal_text(model))
    back = ModelFile(path=str(path), shapes=shapes).read()
    np.testing.assert_allclose(back.position, model.position, atol=1e-6)
    np.testing.assert_allclose(back.translation, model.translation, atol=1e-6)
    np.testing.assert_allclose(back.frequency, model.frequency, rtol=1e-5)
    if suffix == ".bdf":
        with pytest.raises(UserError, match="no mode shapes; name the universal file"):
            ModelFile(path=str(path)).read()


def test_shapes_without_frequencies_are_refused_until_they_are_given(tmp_path):
    model = own_axes(rotations=False)
    arrays = {f"shape{k}": model.translation[..., k] for k in range(5)}
    path = tmp_path / "model.vtu"
    meshio.Mesh(model.position, [("quad", model.quadrilaterals)], arrays).write(path)
    with pytest.raises(UserError, match=r"no frequencies; give them in Hz with model.frequencies"):
        ModelFile(path=str(path)).read()
    given = ModelFile(path=str(path), frequencies=model.frequency.tolist()).read()
    np.testing.assert_array_equal(given.frequency, model.frequency)
    with pytest.raises(UserError, match="has 5 shapes, not 2"):
        ModelFile(path=str(path), frequencies=[100.0, 200.0]).read()


def test_modes_given_twice_are_refused(tmp_path):
    text = universal_text(own_axes())
    first = text[text.index("    -1\n    55") :].split("    -1\n    55")[1]
    path = written(tmp_path, text + "    -1\n    55" + first)
    with pytest.raises(UserError, match=r"modes 1 and 2 have one frequency, 198.931 Hz"):
        ModelFile(path=path).read()


def test_files_without_a_surface_or_with_lost_values_are_refused(tmp_path):
    model = own_axes()
    nodes = writer.nodes(model.position, np.zeros(len(model.position), int))
    with pytest.raises(UserError, match="but no surface; write shell elements"):
        ModelFile(path=written(tmp_path, writer.units() + nodes)).read()
    text = universal_text(model)
    few = writer.normal_mode([""] * 5, model.translation[:-1, :, 0], 100.0, 1)
    bare = text[: text.index("    -1\n    55")]
    with pytest.raises(UserError, match="no value at the node 63"):
        ModelFile(path=written(tmp_path, bare + few)).read()


def with_volume(tree, size=(0.26, 0.21), shape=(7, 6), center=CENTER):
    sizes = {"size": list(size), "shape": list(shape)}
    volume = Grid(center=list(center), **sizes, layers=3, thickness=0.01)
    return tree | {"volume": volume.group()}


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"unit": LengthUnit.inch}, "model.unit"),
        ({"frame": ModelFrame()}, "say where its axes stand with model.frame"),
        (
            {"frame": ModelFrame(origin=CENTER.tolist(), euler=[0.0, 1.5708, 0.0])},
            "look at the|elsewhere or turned",
        ),
    ],
)
def test_model_in_other_units_or_axes_is_refused(tmp_path, tree, wrong, said):
    text = universal_text(own_axes()).split("    -1\n   164")[-1].split("    -1\n", 1)[1]
    path = written(tmp_path, text)
    assert examine_model(with_volume(tree), LASER, source(path)).shapes.dof > 0
    with pytest.raises(UserError, match=said):
        examine_model(with_volume(tree), LASER, source(path, **wrong))
    past = r"pixels of view 1 (that move )?looks? at the model|none of its"
    with pytest.raises(UserError, match=past):
        examine_model(tree, LASER, source(path, **wrong))


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("size", "shape", "center"),
    [
        ((0.6, 0.5), (13, 11), CENTER),  # reaches far beyond the plate, on all sides
        ((0.6, 0.5), (7, 6), CENTER),
        ((0.6, 0.25), (13, 11), (0.57, 0.14, 0.0)),  # on one side alone
        ((0.1, 0.08), (4, 3), CENTER),  # a part of the plate
    ],
)
def test_right_model_is_taken_where_the_volume_is_larger_or_smaller_than_the_plate(
    tmp_path, tree, size, shape, center
):
    one = source(written(tmp_path, universal_text(own_axes())))
    found = examine_model(with_volume(tree, size, shape, center), LASER, one)
    assert not found.shapes_rejected


@pytest.mark.parametrize(
    ("unit", "size", "said"),
    [
        (
            LengthUnit.inch,
            (0.6, 0.5),
            "lies on the surface of the volume, but is 0.013 times as large",
        ),
        (LengthUnit.m, (0.9, 0.75), "or let the volume be no larger than the structure"),
        (LengthUnit.mm, (0.6, 0.5), "0.0005 times as large"),
    ],
)
def test_model_that_covers_little_of_a_volume_is_refused_before_a_scan(
    tmp_path, tree, unit, size, said
):
    text = universal_text(own_axes()).split("    -1\n   164")[-1].split("    -1\n", 1)[1]
    one = source(written(tmp_path, text), unit=unit).model()
    with pytest.raises(UserError, match=said):
        check_place(one, with_volume(tree, size, (9, 7)))


def test_centimetres_read_as_inches_are_refused_before_a_scan(tmp_path, tree):
    large = replace(own_axes(), position=own_axes().position / 0.0254)
    text = universal_text(large).split("    -1\n   164")[-1].split("    -1\n", 1)[1]
    path = written(tmp_path, text)
    check_place(source(path, unit=LengthUnit.inch).model(), with_volume(tree, (0.3, 0.25), (9, 8)))
    one = source(path, unit=LengthUnit.cm).model()
    with pytest.raises(UserError, match="as large"):
        check_place(one, with_volume(tree, (0.3, 0.25), (19, 16)))


def aside(x):
    return [float(CENTER[0]) + x, *CENTER[1:].tolist()]


def with_rest_beside(tree, speed=0.0):
    """Let each view have as many pixels again beyond the plate's side, 0.05 m away and at rest.

    They may still have this part of the largest speed, as cross-talk gives.
    """
    rng, made = np.random.default_rng(7), dict(tree)
    for name, pose in zip("12", true_poses(), strict=False):
        image = tree[f"modes/image/{name}"]
        dac = np.concatenate([image["dac"].values, aimed(pose, beside=A + 0.05)])
        own, std = image["velocity"].values, image["velocity_std"].values
        rest = std * (rng.normal(size=own.shape) + 1j * rng.normal(size=own.shape))
        made[f"modes/image/{name}"] = group(
            "image",
            {"pixel": np.arange(len(dac)), "frequency": image["frequency"].values},
            velocity=np.concatenate([own, rest + speed * np.abs(own).max(axis=0)]),
            velocity_std=np.concatenate([std, std]),
            dac=dac,
            angle=LASER.angle_from_dac(dac),
            flags=np.zeros(len(dac), int),
        )
    return made


@pytest.mark.one_in(2)
@pytest.mark.parametrize("speed", [0.0, 0.03])
def test_half_of_the_pixels_at_rest_beside_the_model_are_left_out_and_counted(
    tmp_path, tree, speed
):
    path = written(tmp_path, universal_text(closed_form()))
    found = examine_model(
        with_rest_beside(tree, speed), LASER, ModelFile(path=path, thickness=THICKNESS)
    )
    assert not found.shapes_rejected
    assert [len(v.pixels.pixel) for v in found.views] == [17 * 19] * 2
    told = [f for f in findings_about(found) if f.kind == "model_pixels_beside"]
    assert [f.text for f in told] == [
        "model: 646 of 1292 pixels look past it and are left out, all at rest; most in view 1, "
        "323 of 646"
    ]
    assert {f.severity for f in told} == {Severity.note}


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (
            {"unit": LengthUnit.inch},
            r"model.uff: only \d+ of 3\d\d pixels of view 1 that move look",
        ),
        ({"frame": ModelFrame()}, r"model.uff: none of 646 pixels of view 1 looks at the model"),
        (
            {"frame": ModelFrame(origin=aside(0.2))},
            r"model.uff: only \d+ of 3\d\d pixels of view 1 that move look at the model; are",
        ),
    ],
)
def test_model_past_which_moving_pixels_look_is_refused_though_half_are_at_rest(
    tmp_path, tree, wrong, said
):
    text = universal_text(own_axes()).split("    -1\n   164")[-1].split("    -1\n", 1)[1]
    path = written(tmp_path, text)
    assert examine_model(with_rest_beside(tree), LASER, source(path)).shapes.dof > 0
    with pytest.raises(UserError, match=said) as refused:
        examine_model(with_rest_beside(tree), LASER, source(path, **wrong))
    assert str(refused.value).count("\n") == 0


def test_pixels_that_move_beside_the_model_are_told_as_moving(tmp_path, tree):
    path = written(tmp_path, universal_text(own_axes()))
    found = examine_model(tree, LASER, source(path, frame=ModelFrame(origin=aside(0.05))))
    told = [f.text for f in findings_about(found) if f.kind == "model_pixels_beside"]
    assert len(told) == 1
    assert re.search(
        r"1\d\d of 646 pixels .* left out, 1\d\d of them moving; most in view", told[0]
    )


def test_model_in_mm_that_is_read_as_m_is_named(tmp_path, tree):
    model = own_axes()
    large = replace(model, position=1e3 * model.position)
    text = universal_text(large).split("    -1\n   164")[-1].split("    -1\n", 1)[1]
    with pytest.raises(UserError, match=r"1000 times as large, as if it were in mm: model.unit"):
        examine_model(with_volume(tree), LASER, source(written(tmp_path, text)))


def test_axes_are_found_from_points_that_are_known_in_both(tmp_path, tree):
    model = own_axes()
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turned = model.moved(turn, np.array([1.0, 2.0, 3.0]))
    path = written(tmp_path, universal_text(turned))
    corners = [0, 8, 60]
    points = {
        str(k): MatchedPoint(turned.position[k].tolist(), (model.position[k] + CENTER).tolist())
        for k in corners
    }
    placed = source(path, frame=ModelFrame(points=points)).model()
    np.testing.assert_allclose(placed.position, model.position + CENTER, atol=1e-9)
    np.testing.assert_allclose(placed.translation, model.translation, atol=2e-6)
    points["8"].world[0] += 0.05
    with pytest.raises(UserError, match="mm apart from its place in the world"):
        source(path, frame=ModelFrame(points=points)).model()
    with pytest.raises(ConfigError, match="three points or more"):
        source(path, frame=ModelFrame(points={"8": points["8"]}))


def test_model_without_modes_or_poses_to_test_it_on_says_so(tmp_path, tree):
    one = source(written(tmp_path, universal_text(own_axes())))
    for lost, said in (("modes", "no modes to test it on"), ("pose", "have no poses")):
        with pytest.raises(UserError, match=said):
            examine_model({k: v for k, v in tree.items() if k != lost}, LASER, one)
    bare = {k: v for k, v in tree.items() if not k.startswith("modes/image")}
    with pytest.raises(UserError, match="choose modal=own"):
        examine_model(bare, LASER, one)
