"""Findings: where the data disagrees with the model, and what that makes of the results.

A stage that finds something says so as a `Finding`: what kind of mistake, about which view, point,
circle or pixels, how sure that is, how large it is, and which setting would repair it. Stages leave
their findings as groups ``verdict/<stage>``; together they are the group ``verdict`` of a run, and
the worst of them is the run's verdict:

* ``trusted``: nothing that could be tested speaks against the results and their bounds,
* ``doubtful``: something does, and the bounds may be too small,
* ``void``: the bounds cannot be believed.
"""

from __future__ import annotations

import enum
import json
from collections.abc import Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.dataset.store import group
from sldvexp.lazy import xarray as xr

#: Group of all findings; those of a stage are below it until the run is over.
VERDICT = "verdict"
#: Beginning of the names of the groups with the image of every mode, one a view.
MODAL_IMAGES = "modes/image/"

#: Attribute of the group ``pose``: names of the views whose pose was not found, as JSON.
WITHOUT_POSE = "without_pose"


class Severity(enum.IntEnum):
    """How much a finding weighs.

    Attributes
    ----------
    note
        Worth knowing: the results and their bounds stand.
    doubtful
        Bounds may be too small, or something had to be taken on trust that could be wrong.
    void
        Bounds leave out an error that is known to be there.
    """

    note = 0
    doubtful = 1
    void = 2


#: Numbers of a finding, each NaN if there is none.
NUMBERS = ("statistic", "p_value", "size")

#: The run's verdict by its worst finding.
VERDICTS = {Severity.note: "trusted", Severity.doubtful: "doubtful", Severity.void: "void"}


@dataclass(frozen=True)
class Finding:
    """One thing that was found about the data.

    Parameters
    ----------
    kind : str
        Of mistake, as ``sign`` or ``drop_outs``.
    subject : str
        What it is about, as ``view front``, ``point 7``, ``circle 3`` or ``pixels of view left``.
    text : str
        One sentence for people: what, where, and what would be right.
    severity : Severity
    statistic, p_value : float
        Of the test that found it, if one did.
    size : float
        How large it is, in the unit that the text gives.
    remedy : str
        The setting that would repair it, as ``use_repair=[view_front.sign]``.
    views : tuple of str
        Names of the views that it is about; none if it is about all or about none in particular.

    Examples
    --------
    >>> Finding("sign", "view left", "view left has the wrong sign", Severity.void).severity.name
    'void'
    """

    kind: str
    subject: str
    text: str
    severity: Severity = Severity.doubtful
    statistic: float = np.nan
    p_value: float = np.nan
    size: float = np.nan
    remedy: str = ""
    views: tuple[str, ...] = ()


def verdict_of(findings: Iterable[Finding]) -> str:
    """Tell the verdict: ``trusted``, ``doubtful`` or ``void``, by the worst finding.

    Examples
    --------
    >>> verdict_of([]), verdict_of([Finding("noise", "run", "the stated noise is too small")])
    ('trusted', 'doubtful')
    """
    return VERDICTS[max((f.severity for f in findings), default=Severity.note)]


def is_void(groups: Mapping[str, xr.Dataset]) -> bool:
    """Tell whether the bounds of a run's velocities cannot be believed.

    Examples
    --------
    >>> is_void({})
    False
    """
    return VERDICT in groups and groups[VERDICT].attrs[VERDICT] == VERDICTS[Severity.void]


def findings_to_dataset(findings: Sequence[Finding]) -> xr.Dataset:
    """Make a group of findings, the worst first.

    Examples
    --------
    >>> found = findings_to_dataset([Finding("sign", "view left", "wrong sign", Severity.void)])
    >>> found.attrs["verdict"], found["severity"].values.tolist()
    ('void', ['void'])
    """
    ordered = sorted(findings, key=lambda f: -f.severity)
    texts = {
        name: np.array([str(getattr(f, name)) for f in ordered], dtype=str)
        for name in ("kind", "subject", "text", "remedy")
    }
    numbers = {name: np.array([getattr(f, name) for f in ordered], float) for name in NUMBERS}
    texts["views"] = np.array([json.dumps(f.views) for f in ordered], dtype=str)
    severity = np.array([f.severity.name for f in ordered], dtype=str)
    found = group(
        VERDICT, {"finding": np.arange(len(ordered))}, **texts, severity=severity, **numbers
    )
    return found.assign_attrs(verdict=verdict_of(findings))


def findings_of(groups: Mapping[str, xr.Dataset]) -> list[Finding]:
    """Read the findings of a run, or those that its stages have left so far, the worst first.

    Parameters
    ----------
    groups : mapping of str to xarray.Dataset
        Of the run, by their path.

    Examples
    --------
    >>> one = Finding("drop_outs", "pixels of view left", "3 pixels left out", Severity.note)
    >>> findings_of({"verdict/images": findings_to_dataset([one])})[0].text
    '3 pixels left out'
    """
    whole = [groups[VERDICT]] if VERDICT in groups else []
    stages = whole or [g for k, g in groups.items() if k.startswith(f"{VERDICT}/")]
    found = [
        Finding(
            kind=str(one["kind"].item()),
            subject=str(one["subject"].item()),
            text=str(one["text"].item()),
            severity=Severity[str(one["severity"].item())],
            statistic=float(one["statistic"]),
            p_value=float(one["p_value"]),
            size=float(one["size"]),
            remedy=str(one["remedy"].item()),
            views=tuple(json.loads(str(one["views"].item()))) if "views" in one else (),
        )
        for stage in stages
        for one in (stage.isel(finding=i) for i in range(stage.sizes["finding"]))
    ]
    return sorted(found, key=lambda f: -f.severity)


#: Attribute of a group whose maker leaves no group of findings of its own, as JSON.
FINDINGS = "findings"


def with_findings(made: xr.Dataset, findings: Sequence[Finding]) -> xr.Dataset:
    """Leave findings with a group, for the step that takes it into the run.

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> found = with_findings(xr.Dataset(), [Finding("sign", "view left", "is it turned?")])
    >>> list(found.attrs)
    ['findings']
    """
    if not findings:
        return made
    texts = [
        {name: getattr(f, name) for name in ("kind", "subject", "text", "remedy", "views")}
        | {"severity": f.severity.name}
        | {name: v for name in NUMBERS if np.isfinite(v := getattr(f, name))}
        for f in findings
    ]
    return made.assign_attrs({FINDINGS: json.dumps(texts)})


def take_findings(groups: MutableMapping[str, xr.Dataset]) -> list[Finding]:
    """Take what `with_findings` left out of groups, each finding once.

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> odd = with_findings(xr.Dataset(), [Finding("unit", "view left", "metres or millimetres?")])
    >>> [finding.text for finding in take_findings({"image/a": odd, "image/b": odd})]
    ['metres or millimetres?']
    """
    found: dict[Finding, None] = {}
    for name, made in groups.items():
        if FINDINGS in made.attrs:
            attrs = dict(made.attrs)
            for one in json.loads(attrs.pop(FINDINGS)):
                typed = {"severity": Severity[one["severity"]], "views": tuple(one["views"])}
                found[Finding(**one | typed)] = None
            bare = made.copy()
            bare.attrs = attrs
            groups[name] = bare
    return list(found)


def views_without_pose(groups: Mapping[str, xr.Dataset]) -> list[str]:
    """Name the views whose pose was looked for and not found, so that they are left out.

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> views_without_pose({"pose": xr.Dataset(attrs={"without_pose": '["left"]'})})
    ['left']
    """
    attrs = groups["pose"].attrs if "pose" in groups else {}
    return [str(name) for name in json.loads(attrs.get(WITHOUT_POSE, "[]"))]
