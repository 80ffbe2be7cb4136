"""Bases of the plugins of the group `scan`.

`ScanPart` is what all have in common, `ImageScan` what gives a velocity image of each view, and
`PersonPart` what a person does: points the beam, or measures where it falls.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import Checks, UserError
from sldvexp.files import unusable
from sldvexp.geometry import KnownPose
from sldvexp.laser import TwoMirror, dac_of_points
from sldvexp.signal import Excitation, ExcitationKind, LineChoice
from sldvexp.targets import Target
from sldvexp.typing import Array, IntArray


class Trigger(Enum):
    """When the first record of a pixel starts; the others follow without a gap.

    Attributes
    ----------
    generator
        With the generator's own period, burst or blow.
    free
        At any time, as the beam comes to rest.
    """

    generator = "generator"
    free = "free"


@dataclass
class Sampling:
    """How each pixel is sampled.

    Parameters
    ----------
    rate : float, Hz
    samples : int
        Of a record.
    frequency : list of float, Hz
        Of a sine; all others have a band.
    amplitude : float, V
        Of the excitation: the peak of each frequency of a sine, the r.m.s. of any other while it
        plays, the peak of a hammer's blow.
    excitation : ExcitationKind
        Any but a sine needs signal=response, and is measured in several records.
    band : list of 2 float, Hz
        Lowest and highest frequency of all but a sine.
    lines : LineChoice
        Lines of the band that a multisine or a pseudo-random signal excites.
    seed : int
        Of what is random about it.
    burst : float
        Share of the record that a random burst plays for.
    decay : float, s
        Time constant of a hammer's exponential window; 0 for none.
    records : int
        That are averaged; of a sine a pixel has one, whatever this says.
    lead : int, optional
        Records that are let go by after each move, before the first that counts; without it one of
        a signal that repeats, in which what the generator's start set off dies, and else none.
    trigger : Trigger
    again : int
        How many records of a pixel may be taken again in the place of those that an overload, a
        lost signal or a missed trigger spoilt.
    spare : float, s
        Time for samples at the end of each view, in which pixels of the worst coherence are
        measured once more.
    """

    rate: float = 25600.0
    samples: int = 512
    frequency: list[float] = field(default_factory=lambda: [450.0])
    amplitude: float = 1.0
    excitation: ExcitationKind = ExcitationKind.sine
    band: list[float] = field(default_factory=lambda: Excitation().band)
    lines: LineChoice = Excitation.lines
    seed: int = Excitation.seed
    burst: float = Excitation.burst
    decay: float = Excitation.decay
    records: int = 10
    lead: int | None = None
    trigger: Trigger = Trigger.generator
    again: int = 10
    spare: float = 0.0

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is wrong."""
        checks.positive(f"{name}.rate", self.rate)
        checks.positive(f"{name}.amplitude", self.amplitude)
        enough = f"must be at least 16, not {self.samples}"
        checks.require(self.samples >= 16, f"{name}.samples", enough)
        if self.excitation is ExcitationKind.sine:
            self._check_tones(checks, f"{name}.frequency")
        else:
            self._check_band(checks, name)
        for key in ("lead", "again"):
            value = getattr(self, key) or 0
            checks.require(value >= 0, f"{name}.{key}", f"must be 0 or more, not {value}")
        few = f"must be 2 or more, for one alone tells no error, not {self.records}"
        checks.require(self.records >= 2, f"{name}.records", few)
        checks.non_negative(f"{name}.spare", self.spare)

    def _check_tones(self, checks: Checks, name: str) -> None:
        checks.require(bool(self.frequency), name, "needs at least one frequency")
        for hertz in self.frequency:
            checks.positive(name, hertz)
            too_high = f"{hertz:g} Hz needs a rate above {2 * hertz:g} Hz"
            checks.require(2 * hertz < self.rate, name, too_high)

    def _check_band(self, checks: Checks, name: str) -> None:
        known = len(checks.problems)
        self.played.check(checks, name)
        told = (
            f"must be generator, for a record of {self.excitation.name} that starts at any time "
            "holds a part of it"
        )
        begun = self.excitation in (ExcitationKind.burst_random, ExcitationKind.hammer)
        checks.require(self.trigger is Trigger.generator or not begun, f"{name}.trigger", told)
        if len(checks.problems) > known:
            return
        low, high = self.band
        too_high = f"up to {high:g} Hz needs a rate above {2 * high:g} Hz"
        checks.require(2 * high < self.rate, f"{name}.band", too_high)
        spacing = self.rate / self.samples
        empty = (
            f"has no line of a record of {1 / spacing:g} s, whose lines are {spacing:g} Hz apart"
        )
        lines = int(high / spacing) >= max(1, low / spacing)
        checks.require(lines, f"{name}.band", empty)

    @property
    def played(self) -> Excitation:
        """What the generator plays."""
        return Excitation(
            self.excitation,
            self.band,
            self.amplitude,
            self.lines,
            self.seed,
            self.burst,
            self.decay,
        )

    @property
    def triggered(self) -> bool:
        """True if records start with the generator."""
        return self.trigger is Trigger.generator

    @property
    def broadband(self) -> bool:
        """True if anything but a sine is played."""
        return self.excitation is not ExcitationKind.sine

    @property
    def let_go(self) -> int:
        """Records that are let go by after each move."""
        return self.played.lead if self.lead is None else self.lead

    @property
    def samples_in_all(self) -> int:
        """Samples behind each pixel."""
        return self.samples * (self.records if self.broadband else 1)

    @property
    def seconds(self) -> float:
        """Time that a pixel takes, s."""
        let_go = self.let_go * self.samples if self.broadband else 0
        return (let_go + self.samples_in_all) / self.rate

    def amplitude_at(self, frequency: ArrayLike) -> Array:
        """Give the nominal amplitude of the reference at lines, shape (line,), V.

        Parameters
        ----------
        frequency : array_like, shape (line,), Hz
        """
        hertz = np.atleast_1d(np.asarray(frequency, float))
        if not self.broadband:
            return np.full(len(hertz), self.amplitude)
        design = self.played.design(self.rate, self.samples)
        nearest = np.abs(design.frequency - hertz[:, None]).argmin(axis=1)
        return design.reference_amplitude[nearest]


class Scan(ABC):
    """Base of the plugins: which views there are, and what is scanned in each of them.

    Attributes
    ----------
    rough_poses_key : str
        Setting that takes the rough poses of views, for messages.
    """

    rough_poses_key: ClassVar[str] = "scan.views"

    @abstractmethod
    def view_names(self) -> list[str]:
        """List views in the order in which the session goes through them."""

    @abstractmethod
    def parts(self, view: str) -> list[ScanPart]:
        """List what is scanned in a view, in that order, without moving the instrument between."""

    @abstractmethod
    def inputs(self) -> list[str]:
        """List files that are read besides the configuration."""

    def in_steps(
        self,
        laser: TwoMirror,
        target: Target | None,
        poses: Mapping[str, KnownPose] = MappingProxyType({}),
    ) -> Self:
        """Say in DAC steps all that is said by points of the world and a rough pose.

        Parameters
        ----------
        poses : mapping of str to KnownPose
            Better poses of views than the rough ones.

        Raises
        ------
        UserError
            That names a view and a point behind the instrument, or beyond its mirrors.
        """
        return self

    def rough_poses(self) -> dict[str, KnownPose]:
        """Give the rough poses that views have, by the views' names."""
        poses = {}
        for view in self.view_names():
            for part in self.parts(view):
                if pose := getattr(part.views[view], "pose", None):
                    poses[view] = pose
        return poses


class ScanPart(Scan):
    """Base of scans that give one kind of result.

    Attributes
    ----------
    kind : str
        What a session makes of the samples, a key of `sldvexp.session.session.KINDS`; it says which
        further methods such a scan has.
    views : dict of str to dataclass
        What is scanned in each view. Where an entry has a `path`, that file says it.
    sampling : Sampling
    """

    kind: ClassVar[str]
    views: dict[str, Any]
    sampling: Sampling

    def view_names(self) -> list[str]:
        """See `Scan`."""
        return list(self.views)

    def parts(self, view: str) -> list[ScanPart]:
        """See `Scan`."""
        return [self]

    def inputs(self) -> list[str]:
        """See `Scan`."""
        return [v.path for v in self.views.values() if v.path]

    @abstractmethod
    def pixel_count(self, view: str) -> int:
        """Count how many pixels a view takes.

        Raises
        ------
        UserError
            If a file that says what to scan is not in order.
        """

    @abstractmethod
    def known_pixels(self, view: str) -> IntArray:
        """Say where the beam goes in a view, as far as it is known beforehand, shape (pixel, 2)."""

    def seconds(self, view: str) -> float:
        """Estimate how long a view's samples take, s."""
        return self.pixel_count(view) * self.sampling.seconds


def check_view_names(checks: Checks, views: Iterable[str]) -> None:
    """Note which views have no usable names; that there are any, the session looks after."""
    for name in views:  # each has a folder of its lines and a group of its results
        wrong = unusable(name)
        checks.require(not wrong, "views", f"the name of the view {name!r} {wrong}")


def check_pairs(
    checks: Checks,
    name: str,
    key: str,
    pairs: list[list[int]],
    path: str,
    count: int = 0,
    told: str = "",
) -> None:
    """Note under `name` what is wrong with pairs of DAC steps or the file that holds them.

    Parameters
    ----------
    name : str
        Of the view's entry.
    key : str
        What the pairs are called there.
    count : int
        How many pairs there must be; 0 for any number.
    told : str
        Message if there are both or none.
    """
    one = bool(pairs) != bool(path)
    checks.require(one, name, told or f"give either {key} or path, not both or none")
    good = all(len(pair) == 2 for pair in pairs) and len(pairs) in (0, count or len(pairs))
    told = f"must be {count or ''} pairs [up_down, left_right]".replace("  ", " ")
    checks.require(good, f"{name}.{key}", told)


def check_rough_pose(checks: Checks, name: str, pose: KnownPose) -> None:
    """Note under `name` what is wrong with a rough pose."""
    pose.check(checks, name)
    exact = bool(pose.euler_std or pose.origin_std or pose.samples)
    checks.require(not exact, name, "is a rough pose, without standard deviations and samples")


def check_points(checks: Checks, name: str, points: list[Any], least: int) -> None:
    """Note under `name` what is wrong with points of the world, `least` or more."""
    few = f"must be {least} or more points of the world, not {len(points)}"
    checks.require(len(points) >= least, name, few)
    for i, point in enumerate(points):
        whole = isinstance(point, list) and all(isinstance(x, int | float) for x in point)
        good = whole and len(point) == 3
        checks.require(good, f"{name}[{i}]", f"must be three numbers x, y, z, not {point}")
        if good:
            checks.finite(f"{name}[{i}]", *point)


def aim_points(
    view: str, points: ArrayLike, names: list[str], pose: KnownPose, laser: TwoMirror
) -> Array:
    """Predict DAC steps, not rounded, of points of the world in a view, shape (N, 2).

    Raises
    ------
    UserError
        That names the view and the point that cannot be reached.
    """
    try:
        return dac_of_points(points, pose.rotation, pose.place, laser, names)
    except UserError as error:
        raise UserError(f"scan: in the view {view}, {error}") from None


class ImageScan(ScanPart):
    """Base of the scans whose pixels are known beforehand; `lines` is what they add."""

    kind: ClassVar[str] = "image"

    @abstractmethod
    def lines(self, view: str) -> list[IntArray]:
        """List the pixels of a view line by line.

        A session that was cut off repeats at most one line.

        Returns
        -------
        list of ndarray of int, shape (pixel, 2)
            DAC steps (up_down, left_right).

        Raises
        ------
        UserError
            If a file is not in order, or there are no such pixels.
        """

    def shape(self, view: str) -> tuple[int, int] | None:
        """Return rows and columns, if the pixels are a grid."""
        return None

    def known_pixels(self, view: str) -> IntArray:
        """See `ScanPart`; all of them."""
        return np.concatenate(self.lines(view))

    def pixel_count(self, view: str) -> int:
        """See `ScanPart`."""
        return sum(map(len, self.lines(view)))


class PersonPart(ScanPart):
    """Base of scans without samples: a person at the instrument gives what is asked for."""

    def pixel_count(self, view: str) -> int:
        """See `ScanPart`; nothing is sampled."""
        return 0

    def seconds(self, view: str) -> float:
        """See `ScanPart`; nobody knows how long a person takes."""
        return 0.0
