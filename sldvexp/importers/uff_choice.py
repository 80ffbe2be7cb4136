"""Choice of a view's functions in a universal file: one a node, of one reference and quantity.

Files of scanning vibrometers have several functions of a node: of several references, and the
displacement, velocity and acceleration of one motion. Of the latter one is read, and the others
bear witness: with ``x = X exp(+-i omega t)`` each is the derivative of the one before, a factor
``+-i omega``, so that a wrong sign of the phase or a wrong quantity shows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError, nearest
from sldvexp.importers.conventions import Conventions, Phase, Quantity
from sldvexp.importers.questions import ViewQuestions
from sldvexp.importers.uff_conventions import (
    BY_NUMBER,
    OF_REFERENCE,
    FunctionKind,
    read_label,
)
from sldvexp.io.uff import Function, UniversalFile
from sldvexp.io.uff.functions import ACCELERATION, DIRECTIONS, DISPLACEMENT, KINDS, VELOCITY
from sldvexp.typing import Array, IndexArray

#: Quantities that are, or may be, a motion; others are of a reference.
MOTION = (0, 1, DISPLACEMENT, VELOCITY, ACCELERATION)
#: Reference degree of freedom that is no restriction.
ANY = "any"
#: Setting of an importer for further references.
OTHERS = "further_references"
#: Which of several quantities of one motion is read.
PREFERRED = (Quantity.velocity, Quantity.displacement, Quantity.acceleration)
#: How far, relatively, witnesses of one motion may be apart, and functions that are witnesses.
AGREE, WITNESSES = 0.3, 20


@dataclass(frozen=True)
class FunctionChoice:
    """Settings that choose among the functions of a file.

    Parameters
    ----------
    kind : FunctionKind or None
    dof : str
        Response direction, empty for all.
    containing : str
        Text of the identifying lines.
    reference_dof : str
        As ``1+Z``; empty if there may be but one, `ANY` for all.
    time_reference : str
        Degree of freedom of a record that is not measured on the structure.
    quantity : Quantity or None
    """

    kind: FunctionKind | None
    dof: str
    containing: str
    reference_dof: str
    time_reference: str
    quantity: Quantity | None

    def functions(self, file: UniversalFile) -> list[Function]:
        """Choose one function a node, by ascending node.

        Raises
        ------
        UserError
            If there are none, or several of a node; it names the setting that chooses.
        """
        wanted = self._wanted(file)
        known = self._kind(file, wanted)
        of_kind = [f for f in wanted if f.kind == known.value and f.ordinate.kind in MOTION]
        if known is FunctionKind.time:
            of_kind = [f for f in of_kind if f.dof != self.time_reference]
        if known in OF_REFERENCE:
            of_kind = self._of_reference(file, of_kind)
        by_node: dict[int, list[Function]] = {}
        for function in of_kind:
            by_node.setdefault(function.node, []).append(function)
        if not by_node:
            raise UserError(
                f"{file.source.path}: has functions of the type {KINDS[known.value]}, but none of "
                "a displacement, velocity or acceleration"
            )
        chosen = [self._one(file, by_node[node]) for node in sorted(by_node)]
        for function in chosen:
            if abs(function.direction) > 3:
                message = f"is of a rotation ({function.dof}); leave it out with dof"
                raise file.wrong(function, message)
        if known in OF_REFERENCE and self.reference_dof != ANY:
            _require_one_reference(file, chosen)
        return chosen

    def left_out(self, file: UniversalFile, chosen: list[Function]) -> dict[str, str]:
        """Count the functions of the chosen kind that are of no motion, for the record."""
        others = [
            f for f in file.functions if f.kind == chosen[0].kind and f.ordinate.kind not in MOTION
        ]
        return {"left_out": f"{len(others)} functions of no motion"} if others else {}

    def _wanted(self, file: UniversalFile) -> list[Function]:
        """Keep the functions of the view's dof that have the wanted text."""
        functions = file.functions
        if self.kind is FunctionKind.nodal or (self.kind is None and not functions):
            functions = file.nodal_functions(self.containing)
        if not functions:
            raise UserError(
                f"{file.source.path}: has no functions (data sets 58, 58b) and no values at nodes "
                f"(55, 2414){self._restricted()}, but {file.contents}"
            )
        return [
            f
            for f in functions
            if (not self.dof or DIRECTIONS[f.direction] == self.dof)
            and (self.containing in " ".join(f.text))
        ]

    def _kind(self, file: UniversalFile, wanted: list[Function]) -> FunctionKind:
        """Find the kind of functions that are read."""
        kinds = {f.kind for f in wanted}
        if self.kind is not None:
            kinds &= {self.kind.value}
        if FunctionKind.frf.value in kinds:
            kinds.discard(FunctionKind.cross.value)  # it was made of these
        known = kinds & {k.value for k in FunctionKind}
        if len(known) == 1:
            return FunctionKind(known.pop())
        has = ", ".join(sorted(KINDS.get(k, f"type {k}") for k in {f.kind for f in file.functions}))
        fix = "needed are frequency response functions, spectra, cross spectra or time records"
        if known:
            of = [FunctionKind(k).name for k in sorted(known)]
            fix = f"choose with instrument.function={of[0]} or {', '.join(of[1:])}"
        raise UserError(
            f"{file.source.path}: has functions of the type {has or 'none'}{self._restricted()}; "
            f"{fix}"
        )

    def _restricted(self) -> str:
        """Say how the functions were restricted, for a message."""
        by = [f"containing {self.containing!r}"] if self.containing else []
        by += [f"of dof {self.dof}"] if self.dof else []
        by += [f"of function={self.kind.name}"] if self.kind else []
        return f", none that is wanted among those {' and '.join(by)}" if by else ""

    def _of_reference(self, file: UniversalFile, functions: list[Function]) -> list[Function]:
        """Keep the functions of the chosen reference."""
        if self.reference_dof in ("", ANY) or not functions:
            return functions
        kept = [f for f in functions if f.reference_dof == self.reference_dof]
        if not kept:
            raise UserError(
                f"{file.source.path}: has no functions of the reference {self.reference_dof}, "
                f"which instrument.reference_dof names; "
                f"{nearest(self.reference_dof, {f.reference_dof for f in functions})}"
            )
        return kept

    def _one(self, file: UniversalFile, found: list[Function]) -> Function:
        """Choose among the functions of a node."""
        first = found[0]
        if len(found) == 1:
            return first
        of_motion = [f for f in found if _same_motion(f, first)]
        quantities = [stated_quantity(f) for f in of_motion]
        if len(of_motion) == len(found) and len(set(quantities)) == len(found):
            for quantity in (self.quantity, *PREFERRED):
                if quantity in quantities and quantity is not None:
                    return of_motion[quantities.index(quantity)]
        function, other = found[1], first
        if function.entry is other.entry:
            raise file.wrong(
                function,
                f"has values of node {function.node} in several directions ({other.dof}, "
                f"{function.dof}); choose one with dof of the view",
            )
        if function.dof == other.dof and function.reference_dof != other.reference_dof:
            raise self._several_of_node(file, found)
        raise file.wrong(
            function,
            f"and data set {other.entry.number} are both of node {function.node} "
            f"({function.dof} and {other.dof}); choose one with instrument.containing or "
            f"dof of the view",
        )

    def _several_of_node(self, file: UniversalFile, found: list[Function]) -> Exception:
        """Ask for the reference of a node's functions, of which one can be read."""
        first = found[0]
        function = next(f for f in found if f.reference_dof != first.reference_dof)
        several = ", ".join(sorted({f.reference_dof for f in found}))
        why = f", as {ANY} cannot choose among functions of one node"
        others = f", and for modes of all the others with instrument.{OTHERS}"
        return file.wrong(
            function,
            f"is of the reference {function.reference_dof}, data set {first.entry.number} of the "
            f"same node {first.node} of {first.reference_dof}; choose one of {several} with "
            f"instrument.reference_dof={first.reference_dof}"
            f"{why if self.reference_dof == ANY else others}",
        )


def _require_one_reference(file: UniversalFile, functions: list[Function]) -> None:
    """Ask for the reference if functions are of several."""
    first = functions[0]
    for function in functions:
        if function.reference_dof != first.reference_dof:
            several = sorted({f.reference_dof for f in functions})
            shown = ", ".join(several[:5]) + (" ..." if len(several) > 5 else "")
            raise file.wrong(
                function,
                f"is of the reference {function.reference_dof}, data set {first.entry.number} of "
                f"{first.reference_dof}; choose one of {shown} with instrument.reference_dof="
                f"{first.reference_dof}, or say {ANY} if the excitation was one for all",
            )


def _same_motion(one: Function, two: Function) -> bool:
    """Tell whether two functions are of one degree of freedom and reference."""
    return _motion_of(one) == _motion_of(two)


def _motion_of(f: Function) -> tuple[int, ...]:
    """Name the motion that a function is of, whatever its quantity."""
    return f.kind, f.node, f.direction, f.reference_node, f.reference_direction


def stated_quantity(function: Function) -> Quantity | None:
    """Tell the quantity of a function by its own words; None if they are silent."""
    label, _ = read_label(function)
    return BY_NUMBER.get(function.ordinate.kind) or (Quantity[label.quantity] if label else None)


def require_witnesses_agree(
    file: UniversalFile,
    functions: list[Function],
    rules: Conventions,
    frequency: Array,
    lines: IndexArray,
    questions: ViewQuestions,
) -> None:
    """Compare functions with others of the same motion but of another quantity.

    If these do not fit the settings, but would with another quantity or phase, it is asked about.
    """
    pairs = _witnesses(file, functions)
    moving = frequency > 0
    if not pairs or not moving.any():
        return
    omega, at = frequency[moving], lines[moving]
    own, others = (
        np.array([unit * file.values(f)[1][at] for f, unit in column])
        for column in zip(*pairs, strict=True)
    )
    (function, _), (other, _) = pairs[0]
    seen = stated_quantity(other)
    assert seen is not None  # or it were no witness
    phase = Phase.exp_minus if rules.conjugate else Phase.exp_plus
    for quantity, sign in _readings(rules.quantity, phase):
        conjugate = sign is Phase.exp_minus
        one = Conventions(quantity, 1.0, conjugate, {}).velocity(own, omega)
        two = Conventions(seen, 1.0, conjugate, {}).velocity(others, omega)
        if np.linalg.norm(one - two) > AGREE * np.linalg.norm(two):
            continue
        told = (("quantity", rules.quantity, quantity), ("phase", phase, sign))
        wrong = [t for t in told if t[1] is not t[2]]
        if wrong:
            ours = " and ".join(f"instrument.{name}={a.name}" for name, a, _ in wrong)
            theirs = " and ".join(f"instrument.{name}={b.name}" for name, _, b in wrong)
            message = (
                f"and data set {other.entry.number}, the {seen.name} of the same motion, do not "
                f"fit {ours}; they fit {theirs}"
            )
            questions.note(file.wrong(function, message), file.source.path, wrong[0][0])
        return


def _readings(quantity: Quantity, phase: Phase) -> Iterator[tuple[Quantity, Phase]]:
    """List ways to read a file's numbers, that of the settings first."""
    quantities = [quantity, *(q for q in PREFERRED if q is not quantity)]
    yield from ((q, p) for q in quantities for p in (phase, *(p for p in Phase if p is not phase)))


def _witnesses(
    file: UniversalFile, functions: list[Function]
) -> list[tuple[tuple[Function, float], tuple[Function, float]]]:
    """Find functions of the same motion but another quantity, each with its unit in SI."""
    if FunctionKind(functions[0].kind) not in (*OF_REFERENCE, FunctionKind.spectrum):
        return []
    same: dict[tuple[int, ...], list[Function]] = {}
    for f in file.functions:
        same.setdefault(_motion_of(f), []).append(f)
    found: list[tuple[tuple[Function, float], tuple[Function, float]]] = []
    for f in functions[:WITNESSES]:
        unit, quantity = _unit(file, f), stated_quantity(f)
        for other in same.get(_motion_of(f), []):
            stated, its = stated_quantity(other), _unit(file, other)
            alike = not found or stated is stated_quantity(found[0][1][0])
            if unit and its and stated not in (None, quantity) and alike and other.size == f.size:
                found.append(((f, unit), (other, its)))
                break
    return found


def _unit(file: UniversalFile, f: Function) -> float | None:
    """Find a function's unit with its amplitude in SI, by its label or data set 164."""
    label, _ = read_label(f)
    if label is not None:
        return label.factor * (label.amplitude.value if label.amplitude else 1.0)
    return file.units.length if file.units is not None and not f.ordinate.unit else None
