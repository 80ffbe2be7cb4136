"""Examination of the images of all views before a field is made of them.

First pixels that dropped out and patches at rest are left out, view by view. Then the views are
compared with one another (`sldvexp.verdict.comparison`). A view that disagrees is named with the
kind of its mistake and with the repair that would take it away; nothing is repaired that
`use_repair` does not name. When no view is wrong, pixels that the field of all views does not fit
are left out too. Of fewer views than four there is nothing to compare, which is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.field import View
from sldvexp.field.bounds.pointing import pointing_std
from sldvexp.field.visibility.holes import by_hole, nodes_in_holes
from sldvexp.field.visibility.view import views_of
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.session.images import describe_flagged_pixels
from sldvexp.signal import Flag
from sldvexp.targets import Circles, Target
from sldvexp.typing import BoolArray, IndexArray
from sldvexp.verdict.beams import MeasuredSurface, PixelBeams, on_circles
from sldvexp.verdict.comparison import (
    Bench,
    bench_of,
    compare_views,
    pixels_to_follow,
    stated_covariance,
)
from sldvexp.verdict.diagnosis import diagnose
from sldvexp.verdict.drop_outs import (
    disagree,
    disagreeing,
    drop_outs,
    outliers,
    resting,
    used_pixels,
)
from sldvexp.verdict.explanation import (
    LARGE_MISFIT,
    LEAST_PIXELS,
    LEAST_VIEWS,
    ViewTests,
    tells_views_apart,
)
from sldvexp.verdict.joint_fit import JointFit
from sldvexp.verdict.lines import at_few_lines, carried_over
from sldvexp.verdict.pointing_noise import mean_angle, pointing_noise
from sldvexp.verdict.refinement import moved_poses, refine
from sldvexp.verdict.repairs import Repair, examined_repairs
from sldvexp.verdict.repeated import cut_off, repeated_lines, repeated_views
from sldvexp.verdict.wording import (
    disagreement,
    looks_beside,
    noise_finding,
    not_compared,
    pointing_finding,
    unexplained,
    untested,
)
from sldvexp.volume import Volume

#: Share of a view's pixels above which they are no drop-outs.
MOST_LEFT_OUT = 0.15
#: Share of a view's usable pixels that see a surface which other views see well, below which the
#: view was not taken from where it is said to be.
MOST_BESIDE = 0.1
#: Probability below which views are rejected that were tested again with a noise that was found.
AGAIN = 1e-4
#: Part of the misfit that may be left to a finer field where the mirrors' pointing is judged.
FOLLOWED = 0.1
#: Views that a field of three components takes.
LEAST = 3

Groups = Mapping[str, xr.Dataset]


@dataclass(frozen=True)
class Examined:
    """What an examination leaves.

    Attributes
    ----------
    groups : dict of str to Dataset
        Images whose pixels were flagged, images and poses that were repaired.
    findings : list of Finding
    """

    groups: dict[str, xr.Dataset]
    findings: list[Finding]


def examine_views(
    tree: Groups,
    laser: TwoMirror,
    volume: Volume,
    robust: bool = True,
    use_repair: Sequence[str] = (),
    refined: bool = False,
    target: Target | None = None,
) -> Examined:
    """Compare the views of a run with one another.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        With the groups ``pose`` and ``image/<view>``, whose velocities may be in files.
    robust : bool
        Leave out pixels that dropped out and patches at rest.
    use_repair : sequence of str
        Repairs to take, as ``view_left.sign``.
    refined : bool
        Adjust the poses to all images.
    target : Target, optional
        Pixels whose beams meet its circles are left out.

    Raises
    ------
    UserError
        If a repair is named that nothing proposes; or see `sldvexp.field.visibility.view.views_of`.

    Examples
    --------
    Five views of a plate that bends a little; the last has the wrong sign:

    >>> import numpy as np
    >>> from sldvexp import dataset, volume
    >>> from sldvexp.laser.two_mirror import TwoMirror
    >>> from sldvexp.pose.base import pose_to_dataset
    >>> rng, laser, flip = np.random.default_rng(1), TwoMirror(), np.diag([1.0, -1.0, -1.0])
    >>> step = np.radians(np.linspace(-24, 24, 25))
    >>> angle = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    >>> surface = MeasuredSurface.of(volume.Grid(size=[0.2, 0.2], shape=[5, 5]), laser)
    >>> origins = [[-0.4, -0.3, 1.5], [0.4, -0.3, 1.5], [0, 0.4, 1.5], [0, 0, 1.5], [0.4, 0.3, 1.5]]
    >>> origins, names, groups = np.array(origins) / 3, list("abcde"), {}
    >>> covariance = np.diag([1e-4] * 3 + [1e-4] * 3) ** 2
    >>> groups["pose"] = pose_to_dataset(
    ...     names, [flip] * 5, origins, [covariance] * 5, [np.inf] * 5, 0.95
    ... )
    >>> for name, origin, sign in zip(names, origins, [1, 1, 1, 1, -1]):
    ...     dac = laser.dac_from_angle(angle).round()
    ...     place = View.from_arrays(name, flip, origin, np.zeros(625), 1e-6, dac=dac)
    ...     beams = PixelBeams.trace(place, surface, np.arange(625))
    ...     x, y, _ = beams.point.T
    ...     seen = np.zeros((625, 1), complex)
    ...     moves = 1e-3 * np.cos(8 * x) * np.cos(7 * y)
    ...     seen[beams.pixel, 0] = sign * moves * beams.direction[:, 2]
    ...     seen += 1e-5 * (rng.normal(size=seen.shape) + 1j * rng.normal(size=seen.shape))
    ...     groups[f"image/{name}"] = dataset.group(
    ...         "image", {"frequency": [200.0]}, velocity=seen, dac=dac,
    ...         velocity_std=np.full(seen.shape, 1e-5), flags=np.zeros(625, np.uint8),
    ...     )
    >>> found = examine_views(groups, laser, volume.Grid(size=[0.2, 0.2], shape=[5, 5]))
    >>> [(f.kind, f.subject, f.remedy) for f in found.findings]
    [('sign', 'view e', 'use_repair=[view_e.sign]')]
    """
    surface = MeasuredSurface.of(volume, laser)
    circles = target if isinstance(target, Circles) else None
    passes: list[_Examination] = []

    def examine(groups: dict[str, xr.Dataset]) -> tuple[list[Finding], list[Repair]]:
        passes.append(_Examination(groups, surface, robust, circles))
        return passes[-1].findings, passes[-1].repairs

    few = at_few_lines(tree)
    _, findings, taken = examined_repairs(few, use_repair, examine)
    groups = passes[-1].groups
    if refined:
        freed = {r.view: r.free for r in taken if r.kind == "pose"}
        moved, refinement = passes[-1].refine(few["pose"], freed)
        groups |= moved
        findings += refinement
    changed = carried_over(tree, few, groups, taken)
    told = [
        *_repeated(groups),
        *findings,
        *_left_out(few, groups, passes[-1].on_object),
        *_holes(groups, surface),
    ]
    return Examined(changed, told)


class _Examination:
    """One pass over images and poses as they are: flags, findings and repairs that would help."""

    def __init__(
        self,
        groups: Groups,
        surface: MeasuredSurface,
        robust: bool,
        circles: Circles | None = None,
    ) -> None:
        self.groups, self.surface = dict(groups), surface
        self.findings: list[Finding] = []
        self.repairs: list[Repair] = []
        self.agreeing: Bench | None = None
        views = views_of(groups, surface.laser)
        #: Pixels of each view on the calibration object that would be used, (pixel,).
        self.on_object: dict[str, BoolArray] = {}
        if robust and circles is not None:
            for v in views:
                self.on_object[v.name] = on_object = on_circles(v, surface, circles)
                if on_object.any():
                    used = used_pixels(v, surface)
                    on_object &= np.isin(np.arange(len(on_object)), used)
            views = [self._flag(v, self.on_object[v.name], Flag.unlike) for v in views]
        self.met = {
            v.name: PixelBeams.trace(v, surface, np.flatnonzero(v.usable)).pixel for v in views
        }
        self.findings += [found for v in views for found in repeated_lines(v)]
        views = [self._cut_off(v) for v in views]
        if robust:
            views = [self._flag(v, resting(v, self._seen(v)), Flag.resting) for v in views]
            views = [
                self._flag(v, drop_outs(v, used_pixels(v, surface), self._seen(v)), Flag.unlike)
                for v in views
            ]
        views = self._that_see_enough(views)
        bench = None
        if len(views) >= LEAST:
            bench = bench_of(views, surface, stated_covariance(self.groups["pose"], views))
        if views and (bench is None or len(views) < LEAST_VIEWS):
            self.findings.append(untested(len(views), "as nothing that they see moves"))
        if bench is None:
            return
        fit = bench.fit()
        if len(views) >= LEAST_VIEWS and not self._agree(bench, fit):
            return
        self.agreeing = bench
        if robust:
            self._flag_disagreeing(bench, fit)

    def refine(
        self, stated: xr.Dataset, freed: Mapping[str, Sequence[int]]
    ) -> tuple[dict[str, xr.Dataset], list[Finding]]:
        """Adjust the poses to the images, unless that would make views disagree.

        Parameters
        ----------
        stated : xarray.Dataset
            The group ``pose`` before any repair.
        freed : mapping of str to sequence of int
            Numbers of a view's pose that a repair has freed.
        """
        bench, pose = self.agreeing, self.groups["pose"]
        if bench is None:
            return {}, [_not_refined("the views do not agree, or are too few")]
        if not np.any(bench.prior[:-1]):
            return {}, [_not_refined("they have no bounds")]
        if [str(v) for v in pose["view"].values] != bench.names:
            return {}, [_not_refined("a view has a pose but no image")]
        at = {v.name: v for v in views_of(self.groups | {"pose": stated}, self.surface.laser)}
        views = [at[name] for name in bench.names]
        covariance = stated_covariance(stated, views)
        assert covariance is not None  # the bench has a prior
        numbers = {bench.names.index(name): of for name, of in freed.items()}
        found = refine(bench, views, covariance, numbers)
        if not found.agrees:
            return {}, [_not_refined("the views would disagree after it")]
        before, after = (1e3 * np.sqrt(np.mean(h**2)) for h in (found.hit_before, found.hit_after))
        told = Finding(
            "poses_refined",
            "poses",
            f"poses are refined by the images: beams are known to hit within {after:.2g} mm "
            f"(standard error) instead of {before:.2g}; of the motion that all views have in "
            f"common {found.common:.0%} of what was uncertain remains",
            Severity.note,
            size=float(after / 1e3),
        )
        moved = moved_poses(stated, found.moves, found.covariance)
        return {"pose": moved.assign_attrs(pose.attrs)}, [told]

    def _seen(self, view: View) -> IndexArray:
        """Find a view's usable pixels whose beams meet the surface."""
        met = self.met[view.name]
        return met[view.usable[met]]

    def _that_see_enough(self, views: Sequence[View]) -> list[View]:
        """Take those of the views that see enough of the surface to be compared."""
        seen = {view.name: len(self._seen(view)) for view in views}
        few = {name: pixels for name, pixels in seen.items() if pixels < LEAST_PIXELS}
        usable = {v.name: int(v.usable.sum()) for v in views}
        if len(few) < len(views):
            beside = [n for n in few if few[n] < MOST_BESIDE * usable[n]]
            self.findings += [looks_beside(n, few.pop(n), usable[n]) for n in beside]
        if few:
            self.findings.append(not_compared(few))
        return [view for view in views if seen[view.name] >= LEAST_PIXELS]

    def _of_pointing(self, bench: Bench, fit: JointFit, tests: ViewTests) -> Finding | None:
        """Name the mirrors' pointing if that is the noise which is not stated.

        What the test's field cannot follow is large where images bend, much as pointing noise is.
        """
        laser = self.surface.laser
        if tests.misfit <= LARGE_MISFIT or bench.truncation > FOLLOWED:
            return None
        step = pointing_noise(fit, laser)
        if step is None:
            return None
        known = np.mean([pointing_std(laser.pointing_std, d.view) ** 2 for d in bench.data])
        return pointing_finding(tests, step, float(np.sqrt(known)))

    def _agree(self, bench: Bench, fit: JointFit) -> bool:
        """Test the views; False if one is wrong, which is then named.

        A view whose noise is not as stated hides others: they are tested again with that noise.
        """
        for turn in range(len(bench.data)):
            tests = compare_views(bench, fit)
            if turn and tests.least > AGAIN:
                break
            if not tests.rejects:
                self._judge_noise(bench, fit, tests)
                return True
            ranked = diagnose(bench, fit)
            if not ranked[0].view:
                self.findings.append(unexplained(bench.names, tests))
                return False
            best, other = tells_views_apart(ranked)
            finding, repairs = disagreement(bench.names, tests, best, other)
            self.findings.append(finding)
            self.repairs += repairs
            if best.kind != "own_noise":
                break
            bench = bench.with_noise(best.view[0], best.noise)
            fit = bench.fit()
        return False

    def _judge_noise(self, bench: Bench, fit: JointFit, tests: ViewTests) -> None:
        """Say if the noise of all views is not as stated."""
        if bench.stated and (noise := noise_finding(tests, pixels=_more_pixels(bench, tests))):
            self.findings.append(self._of_pointing(bench, fit, tests) or noise)

    def _flag_disagreeing(self, bench: Bench, fit: JointFit) -> None:
        """Leave out pixels that the field of all views does not fit, if they are too many."""
        pointing = self._pointing(bench, fit)
        if not disagree(fit, pointing):
            return
        marked_each = zip(bench.data, fit.designs, disagreeing(fit, pointing), strict=True)
        for data, design, bad in marked_each:
            marked = np.zeros(len(data.view.dac), bool)
            marked[outliers(data, design, bad)] = True
            self._flag(data.view, marked, Flag.unlike)

    def _pointing(self, bench: Bench, fit: JointFit) -> list[float]:
        """Take the pointing noise that is known of every view, or what the misfit tells, rad."""
        laser = self.surface.laser
        told = pointing_noise(fit, laser) if fit.squares > LARGE_MISFIT * fit.dof else None
        steps = [max(pointing_std(laser.pointing_std, d.view), told or 0.0) for d in bench.data]
        return [s * mean_angle(d, laser) for s, d in zip(steps, bench.data, strict=True)]

    def _flag(self, view: View, marked: BoolArray, flag: Flag) -> View:
        """Flag pixels of a view, unless they are so many that the view as a whole is in doubt."""
        share = float(np.mean(marked[view.usable])) if view.usable.any() else 0.0
        if not share:
            return view
        if share > MOST_LEFT_OUT:
            self.findings.append(
                Finding(
                    "drop_outs",
                    f"pixels of view {view.name}",
                    f"{share:.0%} of the pixels of view {view.name} disagree with those around "
                    "them or with the other views: too many to be drop-outs; they are kept, look "
                    "at the image",
                    size=share,
                    views=(view.name,),
                )
            )
            return view
        return self._flagged(view, marked, flag)

    def _cut_off(self, view: View) -> View:
        """Flag pixels whose velocity is cut off, however many they are: none of them is right."""
        marked = cut_off(view)
        if not marked.any():
            return view
        share = float(np.mean(marked[view.usable]))
        at = float(np.max(np.abs(view.velocity[marked])))
        self.findings.append(
            Finding(
                "cut_off",
                f"pixels of view {view.name}",
                f"{int(marked.sum())} pixels of view {view.name} ({share:.1%}) have the same "
                f"largest velocity, {1e3 * at:.4g} mm/s at most: cut off, by too small a range or "
                "by what wrote the file; they are left out",
                Severity.note if share <= MOST_LEFT_OUT else Severity.doubtful,
                size=share,
                views=(view.name,),
            )
        )
        return self._flagged(view, marked, Flag.saturated)

    def _flagged(self, view: View, marked: BoolArray, flag: Flag) -> View:
        """Flag pixels of a view and of its image."""
        name = f"image/{view.name}"
        image = self.groups[name]
        flags = image["flags"].values.astype(np.uint8)
        flags[marked] |= np.uint8(flag)
        image = image.assign(flags=image["flags"].copy(data=flags))
        image.attrs["summary"] = describe_flagged_pixels(flags)
        self.groups[name] = image
        return replace(view, flags=flags)


def _repeated(groups: Groups) -> list[Finding]:
    """Find views that have the image of another one."""
    return repeated_views(
        {
            name.removeprefix("image/"): image["velocity"].values
            for name, image in groups.items()
            if name.startswith("image/") and not image.attrs.get("left_out")
        }
    )


def _more_pixels(bench: Bench, tests: ViewTests) -> tuple[int, int] | None:
    """Give how many pixels of a view see the surface, and how many its field would take, if more.

    Pixels are counted as the mean over the views.
    """
    wanted = pixels_to_follow(bench, tests.misfit)
    if wanted is None:
        return None
    now = np.mean([len(d.pixel) for d in bench.data])
    return int(now), int(np.ceil(wanted / len(bench.data)))


def _left_out(before: Groups, after: Groups, on_object: Mapping[str, BoolArray]) -> list[Finding]:
    """Count the pixels that were left out, view by view.

    Parameters
    ----------
    on_object : mapping of str to ndarray of bool
        Pixels that are on the calibration object, by view.
    """
    found = []
    for name, image in after.items():
        if not name.startswith("image/") or image is before.get(name):
            continue
        flags = image["flags"].values.astype(int)
        usable = np.maximum(np.sum((flags & ~int(Flag.unlike | Flag.resting)) == 0), 1)
        view = name.removeprefix("image/")
        unlike, away = flags & Flag.unlike != 0, ~on_object.get(view, np.zeros(len(flags), bool))
        told = {
            "on_object": (unlike & ~away, "whose beams meet the calibration object"),
            "drop_outs": (unlike & away, "which neither neighbours nor other views confirm"),
            "at_rest": (
                flags & Flag.resting != 0,
                "at rest while what surrounds it moves: a hole",
            ),
        }
        for kind, (out, why) in told.items():
            if count := int(out.sum()):
                many = f"{count} pixels" if count > 1 else "one pixel"
                why = why.replace("beams meet", "beam meets") if count == 1 else why
                text = f"{many} of view {view} ({count / usable:.2%}) left out, {why}"
                subject = f"pixels of view {view}"
                found.append(
                    Finding(kind, subject, text, Severity.note, size=count / usable, views=(view,))
                )
    return found


def _holes(groups: Groups, surface: MeasuredSurface) -> list[Finding]:
    """Say which nodes are in holes, hole by hole."""
    prisms, found = surface.prisms, []
    marked = nodes_in_holes(views_of(groups, surface.laser), surface.laser, prisms)
    for k, nodes in enumerate(by_hole(marked, prisms)):
        place = prisms.position.reshape(-1, 3)[nodes]
        limits = zip("xyz", place.min(axis=0), place.max(axis=0), strict=True)
        where = ", ".join(f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in limits)
        text = (
            f"{len(nodes)} of {len(marked)} nodes ({where} m) are in a hole, where the images are "
            "at rest: their velocities are left out"
        )
        found.append(Finding("hole", f"hole {k + 1}", text, Severity.note, size=float(len(nodes))))
    return found


def _not_refined(why: str) -> Finding:
    return Finding("poses_not_refined", "poses", f"poses are not refined by the images: {why}")
