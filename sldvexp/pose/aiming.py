"""Aiming: marks of one view as they are taken, and what they say of each other and of the rest.

Places in the world are known; the beam is brought onto one after the other. From the third mark on
the rough poses that fit (`sldvexp.pose.rough_pose`) tell where the next ones lie, and from the
fourth on each mark is compared with where the others put it: the residual of mark i is what was
taken less the prediction from all marks but i, so that a wrong mark cannot pull its own prediction.
A mark errs by the eye and by its place in the world, ``std_i^2 = pointing^2 + (place / distance /
step)^2``; with errors that are stated right, ``cost`` of n marks is chi-square of 2n - 6.

A mark that is taken where it was predicted, without a move by hand, has the steps of the other
marks' pose and no error of its own: it would confirm any pose. It counts as taken, and tells
nothing of where the instrument stands.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from sldvexp.errors import UserError, nearest
from sldvexp.geometry import KnownPose
from sldvexp.instrument.person import Mark, Steps, mark_label
from sldvexp.laser import RoughDoubt, TwoMirror, beyond_told, doubt_of_rough_pose
from sldvexp.pose.base import PoseMethod
from sldvexp.pose.bundle import Bundle
from sldvexp.pose.few_points import AGREE, FLAT, contradiction_of, is_flat, joined
from sldvexp.pose.manual import Manual
from sldvexp.pose.outliers import MatchedPoints
from sldvexp.pose.rough_pose import RoughPose, predicted_angles, predicted_steps, rough_poses
from sldvexp.typing import Array

#: Standard deviation of a person's pointing, as a part of the mirrors' range: one step of a board
#: of 12 bits and a sign (Table 4.3), however much finer the steps of another one are.
POINTING = 1.0 / 8192
#: Standard deviations of the distance of two marks' steps within which they are one place.
SAME = 3.0
#: Standard deviations from which a mark lies beside where the others put it.
BESIDE = 4.0
#: Marks that give a pose.
FEWEST = 3
#: Marks whose own pose is surer than a rough one.
SURE = 4
#: Standard deviation of the origin, as a part of the distance, from which a pose is weak.
WEAK = 0.05


@dataclass(frozen=True, eq=False)
class AimingPlace:
    """A place in the world that the beam can be brought onto.

    Parameters
    ----------
    name : str
        As people call it: ``mark 3``, ``circle 2``, ``corner 1``.
    position : ndarray, shape (3,), m
    std : ndarray, shape (3,), m
        Standard deviation of that.

    Examples
    --------
    >>> import numpy as np
    >>> AimingPlace("mark 3", np.array([0.3, 0.3, 0.0])).std.tolist()
    [0.0, 0.0, 0.0]
    """

    name: str
    position: Array
    std: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, eq=False)
class PlacePrediction:
    """DAC steps at which a place is expected.

    Parameters
    ----------
    dac, std : ndarray, shape (2,), steps
        By the likeliest pose, and their standard deviations.
    others : list of ndarray, shape (2,), steps
        By the other poses that fit the marks, the likeliest first.
    """

    dac: Array
    std: Array
    others: list[Array]

    @property
    def steps(self) -> Steps:
        """Whole steps to go to."""
        up_down, left_right = np.rint(self.dac).astype(int).tolist()
        return up_down, left_right


@dataclass(frozen=True, eq=False)
class MarkResidual:
    """Steps of a mark less those where the other marks put it.

    Parameters
    ----------
    steps, std : ndarray, shape (2,)
        With their standard deviations if all stated errors are right.
    """

    steps: Array
    std: Array

    @property
    def beside(self) -> bool:
        """True if the mark lies farther beside than errors explain."""
        return bool(np.any(np.abs(self.steps) > BESIDE * self.std))


def pointing_of(laser: TwoMirror) -> float:
    """Say how well a person brings the beam onto a mark, DAC steps of each mirror.

    Examples
    --------
    >>> pointing_of(TwoMirror())
    1.0
    """
    low, high = laser.board.value
    return max(1.0, POINTING * (high - low))


class Aiming:
    """Marks of one view as they are taken.

    Parameters
    ----------
    laser : TwoMirror
    places : sequence of AimingPlace
        Those that can be taken, each under a name of its own.
    pointing : float, optional, DAC steps
        Standard deviation of bringing the beam onto a place, of each mirror; without it that of a
        person, see `pointing_of`.
    rough : KnownPose, optional
        Where the instrument roughly stands, with which marks are compared too.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.laser import project
    >>> where = [[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0.1], [0.1, 0.2, 0]]
    >>> places = [AimingPlace(f"mark {k}", np.array(p)) for k, p in enumerate(where)]
    >>> laser, facing = TwoMirror(), np.diag([-1.0, 1.0, -1.0])
    >>> dac = laser.dac_from_angle(project((where - np.array([0.2, 0.1, 1.5])) @ facing.T))
    >>> aiming = Aiming(laser, places)
    >>> for place, steps in zip(places[:4], np.rint(dac)):
    ...     aiming.take(place.name, steps)
    >>> aiming.predict("mark 4").steps, np.rint(dac[4]).astype(int).tolist()
    ((625, 624), [625, 624])
    >>> aiming.contradiction(), aiming.undo(), aiming.open
    ('', 'mark 3', ['mark 3', 'mark 4'])
    """

    def __init__(
        self,
        laser: TwoMirror,
        places: Sequence[AimingPlace],
        pointing: float | None = None,
        rough: KnownPose | None = None,
    ) -> None:
        self.laser, self.rough = laser, rough
        self.places = {place.name: place for place in places}
        self.pointing = pointing_of(laser) if pointing is None else pointing
        self._said: dict[str, Steps | None] = {}
        self._unmoved: frozenset[str] = frozenset()
        self._before: list[tuple[str, dict[str, Steps | None], frozenset[str]]] = []
        self._poses: dict[frozenset[str], list[RoughPose]] = {}
        self._told: str | None = None

    @property
    def taken(self) -> dict[str, Steps]:
        """Marks with their (up_down, left_right) steps, in the order in which they were taken."""
        return {name: steps for name, steps in self._said.items() if steps is not None}

    @property
    def unmoved(self) -> list[str]:
        """Marks taken where they were predicted, which tell nothing, in the order of taking."""
        return [name for name in self.taken if name in self._unmoved]

    @property
    def telling(self) -> dict[str, Steps]:
        """Marks that somebody has moved the beam onto, with their steps: a pose rests on these."""
        return {name: steps for name, steps in self.taken.items() if name not in self._unmoved}

    @property
    def hidden(self) -> list[str]:
        """Places that cannot be seen in this view."""
        return [name for name, steps in self._said.items() if steps is None]

    @property
    def said(self) -> list[str]:
        """Places that are taken or hidden, in the order in which that was said."""
        return list(self._said)

    @property
    def open(self) -> list[str]:
        """Places that are neither taken nor hidden."""
        return [name for name in self.places if name not in self._said]

    def take(self, name: str, dac: Sequence[float] | Array, unmoved: bool = False) -> None:
        """Take a place at steps (up_down, left_right); again, if it was taken or hidden before.

        Parameters
        ----------
        unmoved : bool
            Whether these are the steps of a prediction, from which nobody has moved the beam.
        """
        up_down, left_right = (round(float(step)) for step in dac)
        self.laser.angle_from_dac([up_down, left_right], name)
        self._say(name, (up_down, left_right), unmoved)

    def hide(self, name: str) -> None:
        """Note that a place cannot be seen in this view."""
        self._say(name, None)

    def repeat(self, name: str) -> Steps | None:
        """Open a place again; give the steps where it was, if it was taken."""
        self._require(name)
        before = self._said.get(name)
        if name in self._said:
            self._change(name, {k: v for k, v in self._said.items() if k != name})
        return before

    def undo(self) -> str | None:
        """Take the last of all that was said back; give the place it was about, None if none."""
        if not self._before:
            return None
        name, self._said, self._unmoved = self._before.pop()
        self._forget()
        return name

    @property
    def poses(self) -> list[RoughPose]:
        """Poses that fit all marks, the likeliest first; none before the third mark."""
        return self._poses_from(list(self.telling))

    @property
    def pose(self) -> RoughPose | None:
        """The likeliest pose."""
        return next(iter(self.poses), None)

    @property
    def stand(self) -> tuple[Array, Array] | None:
        """See `AimingGuide`; of the likeliest pose."""
        return None if self.pose is None else (self.pose.rotation, self.pose.origin)

    def steps_at(self, points: Array) -> tuple[Array, Array]:
        """Give DAC steps of points of the world, and their standard deviations by the pose's.

        Parameters
        ----------
        points : ndarray, shape (N, 3), m

        Returns
        -------
        dac, std : ndarray, shape (N, 2), steps
            NaN before the third mark, and for points that the mirrors do not reach.
        """
        if not self.poses:
            return np.full((len(points), 2), np.nan), np.full((len(points), 2), np.nan)
        return predicted_steps(self.poses, points, self.laser)

    def predict(self, name: str) -> PlacePrediction:
        """Tell where a place lies by the marks taken so far; without its own if it is one of them.

        Raises
        ------
        UserError
            If that is not known yet, or the mirrors do not reach it.
        """
        self._require(name)
        others = [other for other in self.telling if other != name]
        poses = self._poses_from(others)
        if not poses:
            raise UserError(
                f"three marks that are not in a line tell where the others lie; "
                f"{len(others)} {'is' if len(others) == 1 else 'are'} taken"
            )
        place = self.places[name]
        point = place.position[None]
        dac, std = (a[0] for a in predicted_steps(poses, point, self.laser))
        if np.isnan(dac).any():
            beyond = self._beyond([place], poses)
            raise UserError(f"{beyond[name]}, as far as is known yet")
        instead = [predicted_steps([pose], point, self.laser)[0][0] for pose in poses[1:]]
        reached = [other for other in instead if np.isfinite(other).all()]
        std = np.hypot(std, self._place_std(place, poses[0]))
        return PlacePrediction(dac, std, reached)

    def scatter(self, name: str, pose: RoughPose) -> tuple[Array, Array]:
        """Give where one pose of other marks has a place, and how a mark of it scatters around.

        Returns
        -------
        dac : ndarray, shape (2,), steps
            NaN where the mirrors do not reach it.
        covariance : ndarray, shape (2, 2), squared steps
            Of the pose, the place in the world and the pointing together.
        """
        self._require(name)
        place = self.places[name]
        point = place.position[None]
        dac = predicted_steps([pose], point, self.laser)[0][0]
        _, (by_pose,) = pose.angles(point, self.laser.mirror_offset)
        own = self.pointing**2 + self._place_std(place, pose) ** 2
        return dac, by_pose / np.outer(self.laser.step, self.laser.step) + own * np.eye(2)

    def out_of_reach(self) -> dict[str, str]:
        """Say of open places that the mirrors do not reach by how much that is, by their names."""
        return self._beyond([self.places[name] for name in self.open], self.poses)

    def residual(self, name: str) -> MarkResidual | None:
        """Compare a mark with where the others put it.

        Returns
        -------
        MarkResidual or None
            None with fewer than three other marks, or if those do not say.
        """
        try:
            expected = self.predict(name)
        except UserError:
            return None
        std = np.hypot(expected.std, self.pointing)
        return MarkResidual(np.array(self.taken[name]) - expected.dac, std)

    def contradiction(self) -> str:
        """Say in one sentence which marks contradict one another; empty if none do."""
        if self._told is None:
            self._told = next(self._same_place(), "") or self._disagreement()
        return self._told

    @property
    def refuted(self) -> list[str]:
        """Marks that the rough pose refutes: one, or all of a few that contradict one another."""
        doubt, count = self._doubt(), len(self.telling)
        own = self._own_disagreement() if doubt is not None else ""
        if doubt is None or count > SURE or (count == SURE and not own):
            return []
        if doubt.wrong:
            return [doubt.wrong]
        return list(self.telling) if own and count < SURE else []

    def trouble(self) -> str:
        """Say in one sentence why no pose of these marks can be believed; empty if one can."""
        count = len(self.telling)
        if count < FEWEST:
            given = f"{count or 'no'} mark{'' if count == 1 else 's'}"
            by_hand = " by moving the beam onto what is seen" * bool(self.unmoved)
            told = (
                f"{given} of this view {'is' if count == 1 else 'are'} taken{by_hand}, and a pose "
                "needs "
            )
            return self.contradiction() or f"{told}three that are not in a line"
        return self.contradiction() or ("" if self.poses else self.weakness())

    def weakness(self) -> str:
        """Say in one sentence why the pose is weak; empty if it is not, or is not known yet."""
        names = list(self.telling)
        if len(names) < FEWEST:
            return ""
        position = np.array([self.places[name].position for name in names])
        centroid = position.mean(axis=0)
        extent = np.linalg.svd(position - centroid, compute_uv=False)
        if extent[1] < FLAT * extent[0]:
            return f"{joined(names)} lie in a line, which leaves the pose open: take one beside it"
        poses = self.poses
        if not poses:
            return f"no pose fits {joined(names)}: take them again"
        if len(poses) > 1 and poses[0].probability < 1 - AGREE:
            places = " or ".join(_metres(pose.origin) for pose in poses)
            return (
                f"{joined(names)} fit {len(poses)} poses, at {places} m: one mark more tells, "
                "best beside their plane"
            )
        if len(names) >= SURE and self._doubt() is not None:
            return "all marks agree with one another but not with the rough pose, which is left out"
        distance = float(np.linalg.norm(centroid - poses[0].origin))
        std = math.sqrt(np.linalg.eigvalsh(poses[0].covariance[3:, 3:])[-1])
        if std < WEAK * distance:
            return ""
        flat = is_flat(position)
        return (
            f"{joined(names)} {'lie in one plane and ' if flat else ''}leave the instrument's "
            f"place uncertain by {std:.2g} m in {distance:.2f}: take marks "
            f"{'beside that plane or ' if flat else ''}farther apart"
        )

    def _say(self, name: str, steps: Steps | None, unmoved: bool = False) -> None:
        self._require(name)
        # A place that is taken again is the last one.
        said = {k: v for k, v in self._said.items() if k != name}
        self._change(name, {**said, name: steps}, unmoved)

    def _change(self, name: str, said: dict[str, Steps | None], unmoved: bool = False) -> None:
        self._before.append((name, self._said, self._unmoved))
        self._said = said
        self._unmoved = self._unmoved | {name} if unmoved else self._unmoved - {name}
        self._forget()

    def _forget(self) -> None:
        """Forget what followed from the marks as they were."""
        self._poses.clear()
        self._told = None

    def _require(self, name: str) -> None:
        if name not in self.places:
            raise UserError(f"there is no place {name}; {nearest(name, self.places)}")

    def _poses_from(self, names: Sequence[str]) -> list[RoughPose]:
        """Find the poses that fit some of the marks; none if those do not determine any."""
        key = frozenset(names)
        if key not in self._poses:
            try:
                self._poses[key] = rough_poses(self._matched(names))
            except UserError:
                self._poses[key] = []
        return self._poses[key]

    def _matched(self, names: Sequence[str]) -> MatchedPoints:
        """Match some marks' places to their angles, with the errors of both."""
        taken = self.taken
        dac = np.array([taken[name] for name in names], float).reshape(-1, 2)
        matched = MatchedPoints(
            np.array([self.places[name].position for name in names]).reshape(-1, 3),
            self.laser.angle_from_dac(dac),
            self.laser.step,
            self.laser.mirror_offset,
            std=np.full(len(names), self.pointing),
        )
        if not any(self.places[name].std.any() for name in names):
            return matched
        # The weight of a place's error depends on its distance.
        pose = rough_poses(matched)[0]
        place_std = np.array([self._place_std(self.places[name], pose) for name in names])
        return replace(matched, std=np.hypot(self.pointing, place_std))

    def _beyond(self, places: Sequence[AimingPlace], poses: Sequence[RoughPose]) -> dict[str, str]:
        """Say of places that the mirrors do not reach by how much that is, by their names."""
        if not poses or not places:
            return {}
        points = np.array([place.position for place in places])
        told = {}
        for place, angle, std in zip(
            places, *predicted_angles(poses, points, self.laser), strict=True
        ):
            if beyond := beyond_told(angle, self.laser):
                sure = f" (+- {std.max():.0f} steps)" if np.isfinite(angle).all() else ""
                told[place.name] = f"{place.name} is {beyond}{sure}"
        return told

    def _place_std(self, place: AimingPlace, pose: RoughPose) -> float:
        """Give the standard deviation, DAC steps, of where a place is seen by its own."""
        distance = np.linalg.norm(place.position - pose.origin)
        return float(place.std.mean() / distance / self.laser.step.mean())

    def _same_place(self) -> Iterator[str]:
        """Find two marks at the same steps."""
        taken = self.taken
        for one, other in combinations(taken, 2):
            apart = np.subtract(taken[one], taken[other])
            if np.all(np.abs(apart) <= SAME * math.sqrt(2) * self.pointing):
                yield (
                    f"{one} and {other} were taken at the same place, {taken[other][0]} "
                    f"{taken[other][1]}: take one of them again"
                )

    def _doubt(self) -> RoughDoubt | None:
        """Compare the marks with the rough pose; None if they fit it, or there is none."""
        taken = self.telling
        if self.rough is None or not taken:
            return None
        places = [self.places[name] for name in taken]
        points = np.array([place.position for place in places])
        distance = np.linalg.norm(points - self.rough.place, axis=1)
        std = np.array([p.std.mean() for p in places]) / distance / self.laser.step.mean()
        return doubt_of_rough_pose(
            taken, points, self.rough, self.laser, np.hypot(std, self.pointing)
        )

    def _disagreement(self) -> str:
        """Say which marks no pose explains, and what to do; the rough pose tells of few."""
        own, doubt = self._own_disagreement(), self._doubt()
        few = len(self.telling) < SURE
        if doubt is not None and doubt.wrong and (few or (own and len(self.telling) == SURE)):
            return doubt.told
        return own or (doubt.told if doubt is not None and few else "")

    def _own_disagreement(self) -> str:
        """Say which marks contradict one another, whatever the rough pose."""
        names = list(self.telling)
        if len(names) < FEWEST or not self.poses:
            return ""
        found = contradiction_of(self._matched(names))
        if found is None:
            return ""
        again = {"exchanged_points": "both", "wrong_point": "it", "residuals": "them"}
        told = found.sentence(names, more=bool(self.open))
        one_of_several = found.kind == "wrong_point" and len(found.points) > 1
        if found.kind == "mirrored" or (one_of_several and self.open):
            return told
        if one_of_several:
            return f"{told}: take them again"
        return f"{told}: take {again[found.kind]} again"


def aiming_at_marks(
    laser: TwoMirror,
    method: PoseMethod | None,
    marks: Sequence[Mark],
    rough: KnownPose | None = None,
) -> Aiming:
    """Make an aiming at the marks of a session, with the eye's error as the pose method has it.

    Examples
    --------
    >>> from sldvexp.pose.manual import Manual
    >>> corner = Mark(3, np.array([0.3, 0.3, 0.0]), np.full(3, 0.0002))
    >>> aiming = aiming_at_marks(TwoMirror(), Manual(pointing=2.0), [corner])
    >>> aiming.open, aiming.pointing
    (['mark 3'], 2.0)
    """
    places = [AimingPlace(mark_label(mark.number), mark.position, mark.std) for mark in marks]
    own = method.pointing if isinstance(method, Manual | Bundle) else None
    return Aiming(laser, places, own, rough)


def _metres(origin: Array) -> str:
    return "(" + ", ".join(f"{x:.2f}" for x in origin) + ")"
