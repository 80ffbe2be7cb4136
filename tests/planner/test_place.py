"""What a stand sees of an object in its room, and why not the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.config.planning import ForbiddenBox
from sldvexp.errors import UserError
from sldvexp.geometry import rotation_towards
from sldvexp.laser import TwoMirror, project
from sldvexp.planner.marks import TargetMarks
from sldvexp.planner.place import Place, Unseen, hides_itself, of_search
from sldvexp.planner.search import candidates, examined
from sldvexp.planner.structure import crosses
from sldvexp.planner.turning import turned_towards
from sldvexp.targets import Circle, Circles, Plane, shaded_circles
from sldvexp.volume import Grid, Prisms, TriangulatedSurface, extruded, vertex_normals
from sldvexp.volume.surface import node_frames
from tests.composing import experiment
from tests.planner.planned_experiments import SMALL


@pytest.fixture(scope="module")
def plate() -> Place:
    return Place.from_experiment(experiment("experiment=plate", *SMALL))


def reasons(place: Place, *origin: float) -> set[Unseen]:
    found = examined(place, np.array([origin]))
    return {Unseen(r) for r in found.why[0]} | {Unseen(found.refused[0])}


def test_many_instruments_stand_upright_as_one_does():
    rng = np.random.default_rng(0)
    origins, points = rng.uniform(-1, 1, (2, 20, 3))
    points[0] = origins[0] + [0, 0.5, 0]  # straight up
    each = [rotation_towards(o, p) for o, p in zip(origins, points, strict=True)]
    np.testing.assert_allclose(rotation_towards(origins, points), each, atol=1e-12)


def test_what_is_to_be_seen_lies_evenly_in_the_ranges_of_the_mirrors():
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.3, 0.3, (30, 3)) * [1, 1, 0.1] + [0.4, 0.1, 0]
    laser = TwoMirror(mirror_offset=0.03)
    origins = np.array([[1.5, 0.5, 1.2], [-1.0, -0.8, 0.9]])
    look_at, rotations = turned_towards(origins, points, laser)
    for origin, point, rotation in zip(origins, look_at, rotations, strict=True):
        np.testing.assert_allclose(rotation, rotation_towards(origin, point), atol=1e-12)
        angles = project((points - origin) @ rotation.T, laser.mirror_offset)
        off = angles.max(axis=0) + angles.min(axis=0)
        assert np.abs(off).max() < 0.02 * np.ptp(angles, axis=0).max()


def test_corners_of_a_surface_are_among_the_nodes_that_stands_are_compared_on():
    """Else a plan leaves a corner beyond a limit, which its check then says."""
    for shape in ([29, 19], [40, 5]):
        grid = Grid(center=[0.66, 0.1, 0.12], size=[0.56, 0.36], shape=shape)
        nodes = grid.prisms().surface
        corners = {0, shape[1] - 1, len(nodes) - shape[1], len(nodes) - 1}
        assert corners <= set(of_search(nodes).tolist())


def test_ways_cross_a_box_where_a_point_of_them_is_inside():
    rng = np.random.default_rng(3)
    origins, points = rng.uniform(-2, 2, (40, 3)), rng.uniform(-2, 2, (30, 3))
    box = ForbiddenBox([-0.5, -0.8, 0.1], [0.4, 0.9, 0.7])
    part = np.linspace(0, 1, 4001)[:, None]
    for origin, told in zip(origins, crosses(origins, points, box.low, box.high), strict=True):
        for point, one in zip(points, told, strict=True):
            way = origin + part * (point - origin)
            inside = ((way > box.low) & (way < box.high)).all(axis=1)
            if inside.sum() != 1:  # a corner that is only grazed
                assert one == inside.any()


def test_a_stand_in_front_sees_all_and_one_behind_nothing(plate):
    assert reasons(plate, 0.4, 0.1, 1.5) == {Unseen.seen}
    assert Unseen.behind in reasons(plate, 0.4, 0.1, -1.5)


@pytest.mark.parametrize(
    ("origin", "reason"),
    [
        ((0.4, 0.1, 3.0), Unseen.far),
        ((0.4, 0.1, 0.9), Unseen.near),
        ((0.4, 1.6, 1.2), Unseen.outside),
        ((2.0, 0.1, 0.5), Unseen.incidence),
        ((-1.6, 0.1, 0.3), Unseen.target_incidence),
    ],
)
def test_limits_of_the_room_say_why(plate, origin, reason):
    assert reason in reasons(plate, *origin)


@pytest.mark.whole
def test_limits_that_nothing_says_are_for_stands_that_are_looked_for():
    e = experiment("experiment=plate", *SMALL)
    given = Place.from_experiment(e, new_stands=False)
    for origin in ((0.4, 0.1, 3.0), (0.4, 0.1, 0.9), (0.4, 1.6, 1.6)):
        assert not reasons(given, *origin) & {Unseen.far, Unseen.near, Unseen.outside}
    said = experiment("experiment=plate", *SMALL, "plan.room.distance=[1.2,2.5]")
    assert Unseen.far in reasons(Place.from_experiment(said, new_stands=False), 0.4, 0.1, 3.0)
    assert said.plan.room.unsaid == ["low", "high"]


@pytest.fixture(scope="module")
def stepped() -> Place:
    """The plate beside four circles, of which the second is on a block and hides the first."""
    e = experiment("experiment=plate", *SMALL)
    centres = {1: (0.03, 0.03), 2: (0.14, 0.03), 3: (0.15, 0.225), 4: (0.03, 0.215)}
    circles = {
        n: Circle(x, y, 0.04, "raised" if n == 2 else "front") for n, (x, y) in centres.items()
    }
    planes = {"front": Plane(), "raised": Plane(origin=[0, 0, 0.1])}
    return Place.from_experiment(replace(e, target=Circles(circles=circles, planes=planes)))


def test_a_stand_from_which_a_circle_hides_another_is_refused(stepped):
    assert Unseen.target_hidden in reasons(stepped, 1.4, 0.1, 1.3)
    assert Unseen.target_hidden not in reasons(stepped, 0.2, 0.1, 1.5)
    found = candidates(stepped.thinned(), 60, np.random.default_rng(0)).examined
    circles = stepped.marks.circles
    assert circles is not None
    assert not any(shaded_circles(origin, circles) for origin in found.origins)


def test_a_block_before_the_structure_hides_nodes_or_its_margin(stepped):
    """From the left, beams to the left edge of the plate go through the raised circle."""
    block = Circle(0.18, 0.14, 0.08, "raised")
    circles = replace(stepped.marks.circles, circles=stepped.marks.circles.circles | {2: block})
    before = replace(stepped, marks=TargetMarks.from_target(circles))
    found = reasons(before, -1.0, 0.15, 1.0)
    assert {Unseen.behind_target, Unseen.rim_behind_target} <= found
    assert not {Unseen.behind_target, Unseen.rim_behind_target} & reasons(before, 0.4, 0.1, 1.5)


def test_a_corner_of_the_scanned_region_beyond_the_mirrors_refuses_a_stand(plate):
    """The volume alone would be within them."""
    narrow = replace(plate, room=replace(plate.room, mirrors=0.6))
    assert reasons(narrow, 0.4, 0.1, 1.6) == {Unseen.seen}
    wide = replace(narrow, region=np.array([[-0.6, 0.1, 0], [1.4, 0.1, 0]]))
    assert Unseen.region_mirrors in reasons(wide, 0.4, 0.1, 1.6)


def test_mirrors_of_a_small_range_do_not_reach_all(plate):
    narrow = replace(plate, room=replace(plate.room, mirrors=0.3))
    assert {Unseen.mirrors, Unseen.target_mirrors} <= reasons(narrow, 0.4, 0.1, 1.3)


def test_forbidden_boxes_keep_stands_out_and_stop_beams(plate):
    box = ForbiddenBox([0.3, 0.0, 0.5], [0.5, 0.2, 2.0])
    shut = replace(plate, room=replace(plate.room, forbidden={"pillar": box}))
    assert Unseen.forbidden in reasons(shut, 0.4, 0.1, 1.5)
    assert Unseen.blocked in reasons(shut, 0.4, 0.1, 2.2)
    table = replace(box, beams=True)
    over = replace(plate, room=replace(plate.room, forbidden={"table": table}))
    assert Unseen.forbidden in reasons(over, 0.4, 0.1, 1.5)
    assert reasons(over, 0.4, 0.1, 2.2) == {Unseen.seen}


def test_a_surface_hides_a_part_of_itself():
    """Two walls of a corner, seen along one of them: the end of it hides nothing, a step does."""
    prisms = stairs()
    place = Place.from_experiment(
        experiment("experiment=plate", "~target", "plan.room.incidence=80", *SMALL)
    )
    place = replace(
        place,
        nodes=prisms.surface,
        frame=prisms.frame,
        outline=prisms.surface,
        surface=prisms,
        clearance=1e-3,
    )
    # From the side of the high part the lower one behind the step is partly hidden.
    x = prisms.surface[:, 0]
    found = examined(place, np.array([[-1.2, 0.0, 1.0], [1.2, 0.0, 1.0]]))
    hidden, open_ = found.why == Unseen.hidden
    assert hidden.any()
    shadow = (x > 0.02) & (x < 0.02 + 0.1 * 1.0)
    assert shadow[hidden].all()
    assert not open_.any()


@pytest.mark.whole
def test_only_a_surface_that_is_not_convex_is_asked_what_it_hides():
    plate, panel = (experiment(f"experiment={name}") for name in ("plate", "curved_panel"))
    assert Place.from_experiment(plate).clearance is None
    assert Place.from_experiment(panel).clearance is None
    assert hides_itself(stairs(), both_sides=False)


def stairs() -> Prisms:
    """Make a step down of 0.1 m at x = 0, over 20 mm, from a triangulated height map."""
    x, y = np.meshgrid(np.linspace(-0.3, 0.3, 31), np.linspace(-0.1, 0.1, 5), indexing="ij")
    z = 0.1 - 0.1 * np.clip(x / 0.02, 0, 1)
    node = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (n.ravel() for n in (node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    surface = TriangulatedSurface(np.stack([x, y, z], -1).reshape(-1, 3), triangles)
    frame = node_frames(surface, vertex_normals(surface), np.array([0.0, 1.0, 0.0]))
    return extruded(surface.position, triangles, frame, np.array([-1e-3, 0, 1e-3]))


def test_candidates_are_within_all_limits():
    settings = ("plan.room.low=[-0.5,null,null]", "plan.room.high=[1.4,0.8,1.6]")
    e = experiment("experiment=plate", *SMALL, *settings, "plan.room.incidence=50")
    place = Place.from_experiment(e)
    found = candidates(place, 300, np.random.default_rng(0)).examined
    origins = found.origins
    assert len(origins) == 300
    assert (origins[:, 0] >= -0.5).all()
    assert (origins <= [1.4, 0.8, 1.6]).all()
    way = origins[:, None] - place.nodes
    far = np.linalg.norm(way, axis=-1)
    assert far.min() >= 1.2
    assert far.max() <= 2.5
    assert np.degrees(np.arccos(way[..., 2] / far)).max() <= 50
    assert found.seen.all()


@pytest.mark.whole
@pytest.mark.parametrize(
    ("setting", "word"),
    [
        ("plan.room.distance=[0.2,0.4]", "plan.room.mirrors"),
        ("plan.room.low=[null,4,null] plan.room.high=[null,5,null]", "plan.room.low"),
        ("plan.room.mirrors=0.05", "plan.room.mirrors"),
        ("plan.room.incidence=3", "plan.room.incidence"),
    ],
)
def test_a_room_without_any_feasible_stand_says_which_limit_forbids_most(setting, word):
    e = experiment("experiment=plate", "volume.shape=[5,5]", "plan.candidates=50", *setting.split())
    place = Place.from_experiment(e)
    with pytest.raises(UserError, match="no stand is feasible") as told:
        candidates(place.thinned(), 50, np.random.default_rng(0))
    assert word in str(told.value).split("next come")[0]
