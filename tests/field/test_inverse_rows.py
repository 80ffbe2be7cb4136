"""Rows of a surface's inverse that are solved together are those that are solved one by one."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable

import numpy as np
import pytest

import sldvexp.field.equations.system as field_system
from sldvexp.errors import UserError
from sldvexp.field import View, VolumeVisibility
from sldvexp.field.bounds.efficiency import LeastVariance, least_variance_model
from sldvexp.field.bounds.inverse import CoupledRows, NearInverse, view_influences
from sldvexp.field.bounds.sparse_inverse_rows import RINGS, NearNodes, surface_rows
from sldvexp.field.equations.assembly import normal_equations
from sldvexp.field.equations.elements import Graph
from sldvexp.field.equations.regions import RegionIterator
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.equations.system import NormalEquations
from sldvexp.laser import TwoMirror
from sldvexp.reconstruction import Absolute, Contravariant, Reconstruction
from sldvexp.volume import Prisms, SampleRule, tensor_rule


def equations_of(
    visibility: VolumeVisibility, method: Reconstruction
) -> tuple[RegionIterator, NormalEquations]:
    parts = RegionIterator(visibility, FieldModel.from_method(method, visibility, local=False))
    nothing = [np.zeros((len(v.dac), 0)) for v in visibility.views]
    return parts, normal_equations(parts, nothing).system


@pytest.mark.one_in(4)
@pytest.mark.parametrize("method", [Absolute(), Contravariant()])
@pytest.mark.parametrize("columns", [12, 24])
def test_together_and_one_by_one(
    make_plate: Callable[..., Prisms],
    make_views: Callable[..., list[View]],
    laser: TwoMirror,
    six_points: SampleRule,
    method: Reconstruction,
    columns: int,
) -> None:
    """Of all nodes, and of a part of them, whose border has no neighbours on one side."""
    shape = (24, 24)
    visibility = VolumeVisibility(make_views(3), laser, make_plate(shape, 2), six_points)
    _, system = equations_of(visibility, method)
    nodes = np.arange(system.graph.nodes)
    own = nodes[nodes % shape[1] < columns]
    together = surface_rows(system, own, nodes, RINGS).toarray()
    some = np.arange(0, len(own), 7)
    each = [surface_rows(system, own[[k]], nodes, RINGS).toarray() for k in some]
    alone = np.concatenate(each)
    rows = (some[:, None] * system.block + np.arange(system.block)).ravel()
    # Measured 0.0003; 0.0027 with rows that are only so far apart that they do not overlap.
    assert np.abs(together[rows] - alone).max() < 5e-4 * np.abs(alone).max()


def test_rows_of_the_least_variance_reach_a_ring_less(
    make_plate: Callable[..., Prisms],
    make_views: Callable[..., list[View]],
    laser: TwoMirror,
    six_points: SampleRule,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What they err by for it is little beside the few percent that the least is known to."""
    monkeypatch.setattr(field_system, "SMALL", 0)
    views = make_views(3, pixels=30)
    visibility = VolumeVisibility(views, laser, make_plate((16, 16), 3), six_points)
    own = FieldModel.from_method(Contravariant(), visibility, local=False)
    model = least_variance_model(visibility, own)
    assert model is not None
    parts = RegionIterator(visibility, model)
    equations = normal_equations(parts, [np.zeros((len(v.dac), 0)) for v in views])
    best = LeastVariance.from_equations(parts, equations)
    assert best is not None
    whole = NearInverse.from_system(equations.system, parts)
    (part,) = parts.overlapping(RINGS, whole=False)
    found = []
    for inverse in (best.inverse, whole):
        rows = inverse.of_part(part)
        assert isinstance(rows, CoupledRows)
        by_view = [
            rows.of_view(view_influences([part], k)[0], model.pixel_std[k] ** 2)[0]
            for k in range(len(views))
        ]
        found.append((np.sum(by_view, axis=0), len(rows.surface.indices)))
    (less, few), (variance, many) = found
    assert few < 0.6 * many
    off = np.sqrt(less / variance) - 1  # measured 0.0017 in the mean, 0.0047 at most
    assert np.sqrt(np.mean(off**2)) < 0.004
    assert np.abs(off).max() < 0.02


def test_a_singular_part_names_its_nodes(
    make_plate: Callable[..., Prisms],
    make_views: Callable[..., list[View]],
    laser: TwoMirror,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One point in each triangle leaves open what adds to zero at every triangle's corners."""
    monkeypatch.setattr(field_system, "SMALL", 0)
    visibility = VolumeVisibility(make_views(3), laser, make_plate((4, 4), 2), tensor_rule(1, 2))
    parts, system = equations_of(visibility, Contravariant())
    inverse = NearInverse.from_system(system, parts)
    (part,) = parts.overlapping(RINGS, whole=False)
    with pytest.raises(UserError, match="too few to determine the surface nodes 0, 1, 2, 3, 4 and"):
        inverse.of_part(part)


def test_the_latest_nodes_are_kept_as_long_as_their_graph(
    make_plate: Callable[..., Prisms],
) -> None:
    graph = Graph.from_prisms(make_plate((6, 6), 2))
    every = np.arange(graph.nodes)
    near = NearNodes.of_own(graph, every[:9], RINGS)
    assert NearNodes.of_own(graph, every[:9].copy(), RINGS) is near
    assert NearNodes.of_own(graph, every[1:10], RINGS) is not near
    last = weakref.ref(NearNodes.of_own(graph, every[:9], RINGS + 1))
    assert last() is NearNodes.of_own(graph, every[:9], RINGS + 1)
    del graph, near
    gc.collect()
    assert last() is None


@pytest.mark.parametrize("between", [0, 2])
def test_one_colour_is_of_nodes_that_are_far_apart(
    make_plate: Callable[..., Prisms], between: int
) -> None:
    """Each has the first colour that is free, even where only some nodes are own ones."""
    graph, rings = Graph.from_prisms(make_plate((13, 11), 2)), 2
    own = np.arange(20, 120)
    colour = NearNodes.of_own(graph, own, rings, between).colour
    reach = [set(graph.around(own[i : i + 1], rings)) for i in range(len(own))]
    beyond = [set(graph.around(own[i : i + 1], rings + between)) for i in range(len(own))]
    for i in range(len(own)):
        taken = {int(colour[j]) for j in range(i) if beyond[i] & reach[j]}
        assert colour[i] == min(set(range(len(own))) - taken)
