"""Sentences about views that disagree: what, by how much, and what would be right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.verdict.explanation import (
    LARGE_MISFIT,
    LEAST_PIXELS,
    LEAST_VIEWS,
    Explanation,
    ViewTests,
)
from sldvexp.verdict.repairs import Repair

#: Probability below which the stated noise is not what the pixels have.
OFF_NOISE = 1e-3
#: Probability below which a small mistake too voids the bounds.
SURE = 1e-6
#: Part of the predicted motion below which a view is taken as one at rest.
STILL = 0.05
#: Standard errors by which a factor must differ from one to explain anything.
SEEN = 3.0
#: Kinds that void the bounds, however sure.
GROSS = (
    "sign",
    "conjugate",
    "conjugate_sign",
    "rms",
    "inverse_rms",
    "other_field",
    "other_values",
    "exchanged",
)
#: Noise of one view, over the stated one, above which it is no noise that could be believed.
GROSS_NOISE = 2.0
#: Noise of all views, over the stated one, below which the latter is hardly a measured one.
OTHER_UNIT = 0.1
#: Kinds that any of four views explains as well.
OF_ANY = ("other_field", "other_values", "pose")


#: Part of the pointing noise that bounds must count.
COUNTED = 0.8


def untested(views: int, why: str) -> Finding:
    """Say that the views are too few to be compared, or see too little.

    Parameters
    ----------
    why : str
        They cannot be compared if they are enough.
    """
    unseen = "a wrong sign, gain, phase or pose of a view cannot be seen"
    told = f"{views} view{'s' * (views > 1)}: {unseen}; {LEAST_VIEWS} views can be compared, five "
    told += "tell which is wrong"
    if views >= LEAST_VIEWS:
        told = f"the views are not compared, {why}: {unseen}"
    return Finding("untested", "views", told, Severity.note)


def not_compared(pixels: Mapping[str, int]) -> Finding:
    """Say that some views see too little to be compared.

    Parameters
    ----------
    pixels : mapping of str to int
        How many of a view's usable pixels see the surface, by the view's name.
    """
    which = f"view{'s' * (len(pixels) > 1)} {', '.join(pixels)}"
    return Finding(
        "untested",
        which,
        f"{which} cannot be compared with others: only {', '.join(map(str, pixels.values()))} "
        f"usable pixels see the surface, and it takes {LEAST_PIXELS}",
        Severity.note,
        views=tuple(pixels),
    )


def looks_beside(name: str, pixels: int, usable: int) -> Finding:
    """Say that a view looks beside a surface that others see.

    Parameters
    ----------
    pixels, usable : int
        How many of its usable pixels see the surface, and how many there are.
    """
    return Finding(
        "beside",
        f"view {name}",
        f"view {name} looks beside the surface that other views see: {pixels} of its {usable} "
        "usable pixels meet it, and it has hardly a part in the results; is a sign, an axis or a "
        "unit of its pose or of its coordinates wrong?",
        Severity.doubtful,
        size=pixels / usable,
        views=(name,),
    )


def pointing_finding(tests: ViewTests, step: float, known: float) -> Finding:
    """Say that the mirrors' pointing explains the misfit; harmless where the bounds hold it.

    Parameters
    ----------
    step, known : float
        Pointing noise that explains it, and what the bounds count, DAC steps.
    """
    told = (
        f"the pixels lie {np.sqrt(tests.misfit):.2f} times their stated noise off a smooth field "
        f"of all views, where the images are steep: the mirrors come to rest {step:.2g} DAC steps "
        "(r.m.s.) beside where they are sent"
    )
    counted = known >= COUNTED * step
    if counted:
        told += f"; bounds count {known:.2g}"
    else:
        told += (
            f"; bounds count {known:.2g} and are too small; laser.pointing_std={step:.2g} is right"
        )
    return Finding(
        "noise",
        "views",
        told,
        Severity.note if counted else Severity.doubtful,
        tests.misfit,
        tests.misfit_p_value,
        step,
        "" if counted else f"laser.pointing_std={step:.2g}",
    )


def noise_finding(
    tests: ViewTests, of_points: bool = False, pixels: tuple[int, int] | None = None
) -> Finding | None:
    """Judge the noise that the views state by the misfit of all, if no view is wrong.

    Parameters
    ----------
    pixels : tuple of int, optional
        How many of a view see the surface, and how many it takes to follow the field.
    """
    what, fit, other = (
        (
            "velocities",
            "what all views agree on",
            "more than one view is wrong, or directions are less exact than stated",
        )
        if of_points
        else (
            "pixels",
            "a smooth field of all views",
            "or the field is finer than the test can follow",
        )
    )
    if tests.misfit > LARGE_MISFIT:
        return Finding(
            "noise",
            "views",
            f"the {what} lie {np.sqrt(tests.misfit):.2f} times their stated noise off {fit}: the "
            f"noise is larger than stated, {other}; bounds are as much too small"
            + ("" if pixels is None else more_pixels(*pixels)),
            Severity.doubtful,
            tests.misfit,
            tests.misfit_p_value,
            float(np.sqrt(tests.misfit)),
        )
    if tests.misfit_p_value < OFF_NOISE:
        return Finding(
            "noise",
            "views",
            f"the noise of the {what} is {np.sqrt(tests.misfit):.3g} times the stated one"
            + (": is that in another unit?" if tests.misfit < OTHER_UNIT**2 else ""),
            Severity.note,
            tests.misfit,
            tests.misfit_p_value,
            float(np.sqrt(tests.misfit)),
        )
    return None


def more_pixels(now: int, wanted: int) -> str:
    """Say how many pixels a view needs for the test to follow the field."""
    return (
        f"; with {wanted} pixels of each view on the surface, instead of {now}, the test could "
        "follow it and tell which"
    )


def disagreement(
    names: Sequence[str],
    tests: ViewTests,
    best: Explanation,
    other: Explanation | None,
    of_points: bool = False,
) -> tuple[Finding, list[Repair]]:
    """Name the view that disagrees, or the two that may, with the repair that would help.

    Parameters
    ----------
    names : sequence of str
        Of all views.
    of_points : bool
        They saw single points, and not a field.
    """
    if not is_significant(best):
        return unexplained(names, tests, of_points), []
    repairs = [r for h in (best, other) if h for r in [repair_of(names, h)] if r]
    which = " or ".join(_views(names, h.view) for h in (best, other) if h)
    accused = tuple(dict.fromkeys(names[k] for h in (best, other) if h for k in h.view))
    told = sentence(names, best)
    if other is not None:
        told = (
            f"{which} disagrees with the others, and it cannot be told which: either {told}; or "
            f"{sentence(names, other)}"
        )
    if len(names) <= LEAST_VIEWS and best.kind in OF_ANY:
        which, accused = "a view", ()
        where = f" at {_listed(best.places)} alone" if best.places else ""
        told = f"a view disagrees with the others{where}; four views cannot tell which"
        repairs = []
    if not best.explains:
        told += (
            "; but that explains not all: more than one view is wrong, the noise is larger than "
            "stated, or "
        )
        told += (
            "directions are less exact than stated"
            if of_points
            else "the field is finer than the test can follow"
        )
    severity = _severity(best, tests)
    test, at = tests.strongest
    finding = Finding(
        best.kind,
        which,
        told,
        severity,
        float(tests.statistic[test][at]),
        tests.least,
        _size(best),
        " or ".join(r.setting for r in repairs),
        views=accused,
    )
    return finding, repairs


def _severity(best: Explanation, tests: ViewTests) -> Severity:
    """Weigh a mistake of a view."""
    if best.kind == "own_noise" and best.noise < 1 and best.explains:
        return Severity.note  # bounds are too wide
    if best.kind == "own_noise" and best.noise < GROSS_NOISE:
        return Severity.doubtful
    gross = best.kind in GROSS or tests.least < SURE
    return Severity.void if gross else Severity.doubtful


def unexplained(names: Sequence[str], tests: ViewTests, of_points: bool = False) -> Finding:
    """Say that views disagree by so little that no kind of mistake explains it.

    Such a disagreement accuses no view; the one whose test says most is in the text.

    Parameters
    ----------
    of_points : bool
        They saw single points, and not a field.
    """
    test, k = tests.strongest
    told = {
        "factor": "has a gain or phase of its own",
        "pose": "was not taken from where its pose says",
        "origin": "was not taken from where its pose says",
        "whole": "is further off than its noise",
        "mistake": "is further off than its noise",
    }
    return Finding(
        "unexplained",
        "views",
        f"the views agree less well than chance allows (p = {tests.least:.1g}), most likely as "
        f"view {names[k]} {told[test]}; but no mistake of one view explains it: "
        + (
            "directions may be a little less exact than stated"
            if of_points
            else "the field may be a little finer than the test can follow"
        )
        + ", or the noise larger than stated",
        Severity.doubtful,
        float(tests.statistic[test][k]),
        tests.least,
    )


def is_significant(of: Explanation) -> bool:
    """Tell whether the factor that is to explain a disagreement differs from one."""
    gain_std, phase_std = of.factor_std
    far = abs(abs(of.factor) - 1) > SEEN * gain_std or abs(np.angle(of.factor)) > SEEN * phase_std
    return of.kind not in ("gain", "phase", "factor") or bool(far)


def _give_or_take(std: float, unit: str = "") -> str:
    """Write a standard error behind a number; nothing where it is not known."""
    return f" +- {std:.1g}{unit}" if np.isfinite(std) else ""


def sentence(names: Sequence[str], of: Explanation) -> str:
    """Say what is wrong with a view."""
    view = _views(names, of.view)
    match of.kind:
        case "pose":
            turned = np.degrees(np.linalg.norm(of.pose[:3]))
            away = 1e3 * np.linalg.norm(of.pose[3:])
            return (
                f"{view} was not taken from where its pose says: it fits turned by "
                f"{turned:.2g} deg and moved by {away:.2g} mm; was the tripod knocked?"
            )
        case "direction":
            told = "looks from another direction than is stated: is the sign of an angle wrong?"
            return f"{view} {told}"
        case "offset":
            return (
                f"{view} has a velocity of its own, the same at all pixels, beside what the others "
                "predict: does the instrument itself vibrate, or is there crosstalk?"
            )
        case "own_noise" if of.noise < 1:
            return (
                f"{view} lies only {of.noise:.3g} times its stated noise off what the others "
                "predict: is the noise of its pixels stated too large?"
            )
        case "own_noise":
            return (
                f"{view} lies {of.noise:.3g} times its stated noise off what the others predict, "
                "in no pattern: is its noise larger, are its pixels or lines in another order, or "
                "are its largest values cut off?"
            )
        case "other_values":
            return (
                f"{view} has other values than the others predict at {_listed(of.places)} alone: "
                "is a number misread, or are points or lines exchanged?"
            )
        case "other_field":
            return (
                f"{view} shows another field: another frequency, another excitation, or a pose "
                "far off"
            )
        case "exchanged":
            return f"{view} are exchanged: each has the velocities of the other"
        case _:
            return _sentence_of_factor(view, of)


def _sentence_of_factor(view: str, of: Explanation) -> str:
    """Say by which factor a view is wrong, and why it may be."""
    c = of.factor
    gain, phase = abs(c) - 1, np.degrees(np.angle(c))
    gain_std, phase_std = of.factor_std[0], np.degrees(of.factor_std[1])
    factor = f"{_complex(c)}{_give_or_take(gain_std)}"
    if shows_nothing(of):
        return (
            f"{view} hardly shows the motion that the others predict, {abs(c):.2g}"
            f"{_give_or_take(abs(c) * gain_std)} times as much: was it blocked, or did nothing "
            "move?"
        )
    match of.kind:
        case "sign":
            return f"{view} has the wrong sign: it is {factor} times what the others predict"
        case "conjugate":
            return f"{view} is conjugated: it has the opposite phase of what the others predict"
        case "conjugate_sign":
            return f"{view} is conjugated and has the wrong sign"
        case "rms":
            return f"{view} gives r.m.s. for peak: it is {factor} times what the others predict"
        case "inverse_rms":
            return f"{view} is {factor} times what the others predict: the others give r.m.s."
        case "gain" if abs(gain) < 1:
            more = "larger" if gain > 0 else "smaller"
            size = f"{100 * abs(gain):.3g} %{_give_or_take(100 * gain_std, ' %')}"
            return (
                f"{view} is {size} {more} than the others predict: "
                "is its range or calibration another?"
            )
        case "phase":
            late = "ahead of" if phase > 0 else "behind"
            return (
                f"{view} is {abs(phase):.3g}{_give_or_take(phase_std)} deg {late} what the others "
                "predict: is its reference or delay another?"
            )
        case "gain":
            return f"{view} is {abs(c):.4g} times what the others predict: are its units others?"
        case _:
            return f"{view} is {factor} times what the others predict"


def shows_nothing(of: Explanation) -> bool:
    """Tell whether a view is at rest while the others move: no factor would make it one of them."""
    return of.kind in ("gain", "phase", "factor") and abs(of.factor) < STILL


def repair_of(names: Sequence[str], of: Explanation) -> Repair | None:
    """Make the repair that a explanation proposes."""
    if not of.view or of.kind in ("direction", "other_values"):
        return None
    view = names[of.view[0]]
    if shows_nothing(of):
        return Repair("left_out", view)
    match of.kind:
        case "sign" | "conjugate_sign":
            return Repair(of.kind, view, factor=-1.0)
        case "conjugate":
            return Repair(of.kind, view)
        case "rms":
            return Repair(of.kind, view, factor=0.5**0.5)
        case "inverse_rms":
            return Repair(of.kind, view, factor=2.0**0.5)
        case "gain":
            return Repair(of.kind, view, factor=abs(of.factor))
        case "phase":
            return Repair(of.kind, view, factor=of.factor / abs(of.factor))
        case "factor":
            return Repair(of.kind, view, factor=of.factor)
        case "pose":
            return Repair(of.kind, view, pose=of.pose, free=of.free, covariance=of.covariance)
        case "exchanged":
            return Repair(of.kind, view, names[of.view[1]])
        case _:
            return Repair("left_out", view)


def _listed(places: Sequence[str]) -> str:
    """List places, the last with an ``and``."""
    *first, last = places
    return f"{', '.join(first)} and {last}" if first else last


def _views(names: Sequence[str], of: Sequence[int]) -> str:
    """Name one view or two."""
    told = " and ".join(names[k] for k in of)
    return f"view{'s' * (len(of) > 1)} {told}"


def _size(of: Explanation) -> float:
    """Give the size of a mistake: of a factor the distance from one, of a pose the turn, rad.

    Of a noise its ratio to the stated one.
    """
    if of.kind == "pose":
        return float(np.linalg.norm(of.pose[:3]))
    if of.kind == "own_noise":
        return of.noise
    return float(abs(of.factor - 1))


def _complex(c: complex) -> str:
    """Write a factor, without a part that is nothing."""
    if abs(c.imag) < 0.02 * abs(c.real):
        return f"{c.real:.4f}"
    return f"{c.real:.3f}{c.imag:+.3f}i"
