"""Labels of units, as people and instruments write them: understood whole, or asked about.

A label is cut into factors, ``mm/s`` into ``mm`` and ``s^-1``. Names, prefixes and dimensions of a
factor are those of `sldvexp.unit_table`; on top stand the spellings of vibrometers, which are
unusual or mean something else there (g a gram). Factors of length and time
are the motion, one of a displacement, velocity or acceleration, or its square; what is left, as the
``N`` of ``(m/s)/N``, is a reference. Words beside the unit tell the amplitude (``rms``, ``p-p``),
and Hz the form of a spectrum.

Assumed is that a label means nothing unless all of it is understood: `read_unit` never leaves a
part out.
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

from sldvexp.errors import UserError
from sldvexp.unit_table import PrefixedUnit, UnitProduct, readings


class Amplitude(Enum):
    """Measure of a sine that a spectrum gives; the value turns it to the peak."""

    peak = 1.0
    rms = 2**0.5
    half = 2.0
    peak_to_peak = 0.5


class SpectralForm(Enum):
    """Form of a spectrum by its unit u, with `u_m` that of the motion and `u_r` of a reference.

    Attributes
    ----------
    linear
        ``u_m``, or ``u_m / u_r`` and ``u_m u_r``.
    power
        ``u_m^2``.
    density
        ``u_m^2 / Hz`` or ``u_m u_r / Hz``.
    root_density
        ``u_m / sqrt(Hz)``.
    transform
        ``u_m / Hz``.
    """

    linear = "linear"
    power = "power"
    density = "density"
    root_density = "root density"
    transform = "transform"


class UnitNotUnderstoodError(UserError):
    """A label that is not understood, or may mean several things; its text says which part."""


@dataclass(frozen=True)
class UnitLabel:
    """Meaning of a label.

    Parameters
    ----------
    text : str
        As it was written.
    quantity : str
        ``displacement``, ``velocity`` or ``acceleration``, and of others as `QUANTITIES`.
    factor : float
        One of the unit in SI; of a power that of the unit whose square it is.
    length : float
        One of a motion's unit of length in m if its times are seconds; 0 of all others, as of g.
    amplitude : Amplitude or None
        None if the label says nothing of it.
    form : SpectralForm
    reference : str
        Unit of a reference, empty if there is none.
    product : bool
        Whether values are multiplied with the reference, as of cross spectra, and not divided.
    """

    text: str
    quantity: str
    factor: float
    length: float = 0.0
    amplitude: Amplitude | None = None
    form: SpectralForm = SpectralForm.linear
    reference: str = ""
    product: bool = False

    @property
    def is_motion(self) -> bool:
        """Whether it is of a displacement, velocity or acceleration."""
        return self.quantity in MOTIONS.values()


#: Quantity of a motion by the powers of length and time.
MOTIONS: dict[tuple[float, float], str] = {
    (1, 0): "displacement",
    (1, -1): "velocity",
    (1, -2): "acceleration",
}
_KINEMATIC = {"length", "time"}
#: Other quantities by a unit of theirs.
QUANTITIES = {
    "newton": "force",
    "volt": "voltage",
    "ampere": "current",
    "pascal": "pressure",
    "watt": "power",
    "gram": "mass",
    "joule": "moment or energy",
    "hertz": "frequency",
    "second": "time",
    "kelvin": "temperature",
}
#: Spellings of vibrometers, with their unit's name.
SPELLINGS = {
    "in": ("", "inch"),
    "mil": ("", "thou"),
    "mils": ("", "thou"),
    "thou": ("", "thou"),
    "mic": ("", "micron"),
    "S": ("", "second"),
    "sek": ("", "second"),
    "sekunde": ("", "second"),
    "seconde": ("", "second"),
    "g": ("", "standard_gravity"),
    "gs": ("", "standard_gravity"),
    "gn": ("", "standard_gravity"),
    "gee": ("", "standard_gravity"),
    "G": ("", "standard_gravity"),
    "Gn": ("", "standard_gravity"),
    "Gs": ("", "standard_gravity"),
    "lbs": ("", "force_pound"),
    "lb": ("", "force_pound"),
    "kp": ("", "force_kilogram"),
    "°": ("", "degree"),
    "grad": ("", "degree"),
    "grade": ("", "degree"),
    "Ω": ("", "ohm"),
    "HZ": ("", "hertz"),
    "hz": ("", "hertz"),
    "KHz": ("kilo", "hertz"),
    "amp": ("", "ampere"),
    "amps": ("", "ampere"),
}
HERTZ, GRAVITY = PrefixedUnit("", "hertz"), PrefixedUnit("", "standard_gravity")
#: No unit of the table, and the only one whose power is half.
ROOT_HERTZ = PrefixedUnit("root", "hertz")
#: Units of several factors.
COMPOUND = {"ips": "in/s", "IPS": "in/s", "fps": "ft/s", "FPS": "ft/s", "kine": "cm/s"}
#: Spellings of labels that are written in capitals throughout.
CAPITALS = {
    name.upper(): name
    for name in (
        *("m", "cm", "mm", "um", "in", "inch", "ft", "mil", "mils", "micron", "microns"),
        *("s", "sec", "min", "lbf", "lb"),
    )
}
#: Prefixes of lengths and times; others, as of a Mm, are more likely a slip. Inches have none.
PREFIXES = {
    "meter": ("", "pico", "nano", "micro", "milli", "centi", "deci", "kilo"),
    "second": ("", "nano", "micro", "milli"),
}
#: Units that may have any prefix.
WITH_PREFIX = {
    *("newton", "volt", "ampere", "pascal", "watt", "gram", "joule", "hertz", "ohm", "coulomb"),
    *("kelvin",),
}
#: Names of several meanings: a thousandth of g or a milligram, a micron or a prefix alone.
AMBIGUOUS = ("mg", "μ")
#: Length of a label beyond which it is no unit.
LONGEST = 80
#: Largest exponents of a unit and of a number that make sense.
UNIT_EXPONENT, NUMBER_EXPONENT = 6, 15
#: How far from a whole number the decimal logarithm of a power of ten may be.
ROUNDING = 1e-9

SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-")
#: Text that is made one spelling before anything is looked up.
SAME = (
    (re.compile("[⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+"), lambda m: "^" + m[0].translate(SUPERSCRIPTS)),
    (re.compile(r"\$?\\mu\b\$?\s*"), "µ"),
    (re.compile(r"\\(?:mathrm|text|rm)\b|\$"), ""),
    (re.compile(r"\\(?:cdot|times)\b"), "*"),
    (re.compile(r"\\sqrt\b"), "√"),
    (re.compile("[−–—‐‑]"), "-"),
    (re.compile("[·⋅•×∙∗]"), "*"),
    (re.compile("[÷⁄∕]"), "/"),
    (re.compile(r"\bper\b"), "/"),
    (re.compile(r"\*\*"), "^"),
    (re.compile(r"\bg_?[0on]\b|\bg's\b", re.I), "gn"),
    (re.compile(r"\bm[iy]u?cro[-\s]*(?=met|m\b)", re.I), "micro"),
    (
        re.compile(
            r"(?:√|\b(?:sqrt|root|rt))\s*[({]?\s*Hz(?:\s*[)}])?"
            r"|\bHz\s*(?:½|\^\s*[({]?\s*(?:0?[.,]5|1\s*/\s*2)\s*[)}]?)",
            re.I,
        ),
        "rootHz",
    ),
    (re.compile("[{\\[]"), "("),
    (re.compile("[}\\]]"), ")"),
)
_PEAK = r"p(?:ea)?k?"
_TO = r"(?:[-_/2\s]|to)*"
#: Words for the amplitude; the longer come first.
AMPLITUDES = (
    (Amplitude.peak, rf"(?:0|o|zero){_TO}{_PEAK}"),
    (Amplitude.peak_to_peak, rf"{_PEAK}{_TO}{_PEAK}|ptp"),
    (Amplitude.peak, r"p(?:ea)?k"),
    (Amplitude.rms, r"r\.?m\.?s\.?|eff\.?|effektiv|effective"),
)
#: Signs between a unit and such a word.
BESIDE = r"[\s,;:_-]*"
#: A unit with such a word at once behind it, as in ``grms``.
GLUED = re.compile(
    r"((?<=\d)|(?<![^\W_])(?:gn?|[munk]?m|ips|m?V|N|s(?:ec)?))(?=(?:rms|pk|pp|p-p)\b)", re.I
)
LOGARITHMIC = re.compile(r"(?<![^\W\d_])dB", re.I)
TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[^\W\d_]+|[°%])"
    r"|(?P<sign>[*/()^]))"
)
EXPONENT = re.compile(
    r"\s*\^\s*\(\s*([+-]?\d+)\s*\)|\s*\^\s*([+-]?\d+)(?![\d.])|([+-]?\d+)(?![\d.])"
)


#: How far two statements of one unit may be apart, relatively, as programs round them.
SAME_UNIT = 1e-3


def same_unit(one: float, two: float) -> bool:
    """Tell whether two statements of a unit in SI mean the same one.

    Examples
    --------
    >>> same_unit(0.0254, 1 / 39.37), same_unit(1.0, 0.9)
    (True, False)
    """
    return abs(one / two - 1) <= SAME_UNIT


@lru_cache(maxsize=512)
def read_unit(text: str) -> UnitLabel:
    """Understand a label of a unit.

    Raises
    ------
    UnitNotUnderstoodError
        If it is empty, any part of it is not known, or it may mean several things.

    Examples
    --------
    >>> read_unit("(mm/s RMS)/N")  # doctest: +NORMALIZE_WHITESPACE
    UnitLabel(text='(mm/s RMS)/N', quantity='velocity', factor=0.001, length=0.001,
              amplitude=<Amplitude.rms: 1.4142135623730951>,
              form=<SpectralForm.linear: 'linear'>, reference='N', product=False)
    >>> read_unit("m/s/m")
    Traceback (most recent call last):
    sldvexp.unit_labels.UnitNotUnderstoodError: the unit 'm/s/m' may mean several things
    """
    if len(text) > LONGEST:
        raise _asked(text, "is too long for a unit")
    if "�" in text or "?" in text:
        raise _asked(text, "has a character that was lost on the way")
    if LOGARITHMIC.search(text):
        raise _asked(text, "is logarithmic; export linear values")
    bare, amplitude = without_amplitude(text)
    if not bare.strip("-"):
        raise _asked(text, "names no unit")
    capitals = not any(c.islower() for c in bare)
    factors, number = _Parser(text, bare, capitals).factors()
    power = math.log10(number) if number > 0 else math.inf
    if power > 0 or abs(power - round(power)) > ROUNDING:
        raise _asked(text, f"has the number {number:g}, which may be a range")
    return _meaning(text, factors, number, amplitude)


def _asked(text: str, what: str) -> UnitNotUnderstoodError:
    """Word that a label is not understood."""
    shown = "".join(c if c.isprintable() else "?" for c in text.strip()[:40])
    return UnitNotUnderstoodError(f"the unit {shown!r} {what}")


def _one_spelling(text: str) -> str:
    """Write signs, exponents and roots in one way."""
    for pattern, by in SAME:
        text = pattern.sub(by, text)
    text = unicodedata.normalize("NFKC", text)
    # Between letters a point multiplies, at a word's end it shortens the word.
    return re.sub(r"(?<=[^\W\d_])\.(?![^\W\d_])", "", _multiplied(text)).strip()


def _multiplied(text: str) -> str:
    """Turn points between factors to ``*``, but those of r.m.s."""
    text = re.sub(r"\br\.m\.s\.?", "rms", text, flags=re.I)
    return re.sub(r"(?<=[^\W_])\.(?=[^\W\d_])", "*", text)


def without_amplitude(text: str) -> tuple[str, Amplitude | None]:
    """Take the words for the amplitude out of a label, and write its signs in one way.

    Raises
    ------
    UnitNotUnderstoodError
        If there are several such words.

    Examples
    --------
    >>> without_amplitude("µm/m rms")
    ('μm/m', <Amplitude.rms: 1.4142135623730951>)
    """
    found = []
    bare = GLUED.sub(r"\1 ", _one_spelling(text))
    for amplitude, words in AMPLITUDES:
        pattern = re.compile(rf"{BESIDE}(?<![^\W_])\(?(?:{words})\)?(?![^\W_]){BESIDE}", re.I)
        bare, count = pattern.subn(_keep_brackets, bare)
        found += [amplitude] * count
    if len(found) > 1:
        raise _asked(text, "names more than one measure of the amplitude")
    bare = re.sub(r"\(\s*\)", "", bare).strip()
    while bare.startswith("(") and _closing(bare) == len(bare) - 1:
        bare = bare[1:-1].strip()
    return bare, found[0] if found else None


def _closing(text: str) -> int:
    """Find where the bracket is closed that a text begins with; -1 if nowhere."""
    depth = 0
    for i, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if not depth:
            return i
    return -1


def _keep_brackets(found: re.Match[str]) -> str:
    """Keep a bracket that the word itself did not open, as in ``(mm/s rms)``."""
    opened, closed = found[0].count("("), found[0].count(")")
    return " " + "(" * (opened > closed) + ")" * (closed > opened)


class _Factor(NamedTuple):
    """Power of a unit, or of several in brackets.

    Parameters
    ----------
    text : str
        As written, without the exponent.
    units : tuple of PrefixedUnit
    whole : UnitProduct
        Of all of them, without the exponent.
    inner : tuple of _Factor
        Those in brackets.
    """

    text: str
    units: tuple[PrefixedUnit, ...]
    whole: UnitProduct
    exponent: int
    inner: tuple[_Factor, ...] = ()

    @property
    def powers(self) -> dict[str, float]:
        """The powers of the base dimensions."""
        return (self.whole**self.exponent).powers

    @property
    def bracketed(self) -> bool:
        """Whether it is a motion as a whole, in brackets or as g."""
        return len(self.units) > 1 or self.units == (GRAVITY,)


class _Parser:
    """Reader of the factors of a label; `bare` is in one spelling."""

    def __init__(self, text: str, bare: str, capitals: bool):
        self.text, self.bare, self.capitals = text, bare, capitals
        self.at = 0
        self.number = 1.0

    def factors(self) -> tuple[list[_Factor], float]:
        """Read all factors, and the number before them."""
        found = self._product(nested=False)
        if self.at < len(self.bare):
            raise self._unknown(self.bare[self.at :])
        return found, self.number

    def _product(self, nested: bool) -> list[_Factor]:
        """Read factors up to the end or to the closing bracket."""
        found: list[_Factor] = []
        sign, expected = 1, True
        while match := TOKEN.match(self.bare, self.at):
            if match["sign"] == ")" and nested:
                break
            start, self.at = self.at, match.end()
            if match["sign"] in ("*", "/"):
                if (expected and found) or (match["sign"] == "*" and expected):
                    raise self._unknown(self.bare[start:])
                sign, expected = (1 if match["sign"] == "*" else -1), True
                continue
            if match["number"]:
                self.number *= self._power(float(match["number"]), sign)
            elif match["sign"] == "(":
                inner = self._product(nested=True)
                if not inner or self.bare[self.at : self.at + 1] != ")":
                    raise self._unknown(self.bare[start:])
                self.at += 1
                exponent = sign * self._exponent()
                found.append(_joined(self.bare[start + 1 : self.at - 1], inner, exponent))
            elif match["name"]:
                found += self._named(match["name"], sign)
            else:
                raise self._unknown(self.bare[start:])
            sign, expected = 1, False
        self.at += len(self.bare[self.at :]) - len(self.bare[self.at :].lstrip())
        if expected:
            raise self._unknown(self.bare[self.at - 1 :] or self.bare)
        return found

    def _exponent(self, bare: bool = True) -> int:
        """Read the exponent that may follow; 1 if there is none."""
        match = EXPONENT.match(self.bare, self.at)
        if not match or (match[3] and not bare):
            return 1
        self.at = match.end()
        found = int(match[1] or match[2] or match[3])
        if abs(found) > (UNIT_EXPONENT if bare else NUMBER_EXPONENT):
            raise self._unknown(match[0])
        return found

    def _power(self, number: float, sign: int) -> float:
        """Raise a number to the exponent that may follow."""
        exponent = sign * self._exponent(bare=False)
        if not 0 < number < math.inf:
            raise self._unknown(f"{number:g}")
        try:
            return float(number**exponent)
        except OverflowError:
            raise self._unknown(f"{number:g}") from None

    def _named(self, name: str, sign: int) -> list[_Factor]:
        """Look up one name, with its exponent."""
        if self.capitals:
            name = CAPITALS.get(name, name)
        if name in COMPOUND:
            inner = _Parser(self.text, COMPOUND[name], False).factors()[0]
            return [_joined(name, inner, sign * self._exponent())]
        known = _known(name)
        if known is None:
            raise self._unknown(name)
        root = known == ROOT_HERTZ
        whole = UnitProduct.from_unit(HERTZ) ** 0.5 if root else UnitProduct.from_unit(known)
        return [_Factor(name, (known,), whole, sign * self._exponent())]

    def _unknown(self, part: str) -> UnitNotUnderstoodError:
        if part.strip() == self.bare:
            return _asked(self.text, "is not known here")
        return _asked(self.text, f"has a part that is not known here, {part.strip()[:20]!r}")


def _joined(text: str, inner: list[_Factor], exponent: int) -> _Factor:
    """Make one factor of those in brackets."""
    if len(inner) == 1:
        return inner[0]._replace(exponent=inner[0].exponent * exponent)
    units = tuple(u for f in inner for u in f.units)
    return _Factor(text.strip(), units, _product_of(inner), exponent, tuple(inner))


def _product_of(factors: list[_Factor]) -> UnitProduct:
    """Multiply factors with one another."""
    return math.prod((f.whole**f.exponent for f in factors), start=UnitProduct())


def _without_mixtures(text: str, factors: list[_Factor]) -> list[_Factor]:
    """Take motions with their reference out of brackets, as in ``(m/s/N)/√Hz``."""
    found = []
    for f in factors:
        mixed = len({set(part.powers) <= _KINEMATIC for part in f.inner}) > 1
        if mixed and f.exponent != 1:  # m/(N s) is a displacement per impulse, or a velocity per N
            raise _asked(text, "may mean several things")
        found += list(f.inner) if mixed else [f]
    return found


@lru_cache(maxsize=512)
def _known(name: str) -> PrefixedUnit | None:
    """Find the unit of a name, with its prefix; None if it is none that we know."""
    if name == "rootHz":
        return ROOT_HERTZ
    if name in AMBIGUOUS:
        return None
    for spelling in (name, name.lower()) if len(name) > 2 else (name,):
        if spelling in SPELLINGS:
            return PrefixedUnit(*SPELLINGS[spelling])
        for found in readings(spelling):
            prefixes = PREFIXES.get(found.unit, ("",))
            if found.prefix in prefixes or found.unit in WITH_PREFIX:
                return found
    return None


def _meaning(
    text: str, factors: list[_Factor], number: float, amplitude: Amplitude | None
) -> UnitLabel:
    """Tell motion, reference and form of a spectrum by the factors."""
    if not factors:
        raise _asked(text, "names no unit")
    factors = _without_mixtures(text, factors)
    hertz = [f for f in factors if f.units in ((HERTZ,), (ROOT_HERTZ,))]
    others = [f for f in factors if f not in hertz]
    if not others:
        if len(hertz) == 1 and hertz[0].exponent == 1 and hertz[0].units == (HERTZ,):
            return UnitLabel(text, "frequency", number)
        raise _asked(text, "may mean several things")
    if len(hertz) > 1 or (hertz and hertz[0].exponent != -1):
        raise _asked(text, "may mean several things")
    kinematic = [f for f in others if set(f.powers) <= _KINEMATIC]
    rest = [f for f in others if f not in kinematic]
    # In (m/s)/g and g/(m/s) the last one is the reference.
    if not rest and len(kinematic) > 1 and kinematic[-1].bracketed and kinematic[-1].exponent == -1:
        rest = [kinematic.pop()]
    quantity, factor, squared = _motion(text, kinematic) if kinematic else ("", 1.0, False)
    in_seconds = bool(quantity) and _in_seconds(kinematic)
    if not quantity:
        quantity, factor, squared = _other(text, others)
        rest = []
    signs = {f.exponent for f in rest}
    if len(signs) > 1 or signs - {1, -1} or (rest and squared):
        raise _asked(text, "may mean several things")
    product = signs == {1}
    form = SpectralForm.power if squared else SpectralForm.linear
    if hertz:
        per_root = hertz[0].units == (ROOT_HERTZ,)
        if per_root and (squared or product):
            raise _asked(text, "may mean several things")
        whole = SpectralForm.density if squared or product else SpectralForm.transform
        form = SpectralForm.root_density if per_root else whole
    factor *= number**0.5 if squared else number
    reference = "*".join(f.text for f in rest)
    length = factor if in_seconds else 0.0
    return UnitLabel(text, quantity, factor, length, amplitude, form, reference, product)


def _in_seconds(factors: list[_Factor]) -> bool:
    """Tell whether units are lengths and seconds alone."""
    units = {u for f in factors for u in f.units} - {PrefixedUnit("", "second")}
    return all(UnitProduct.from_unit(u).powers == {"length": 1} for u in units)


def _without_square(factors: list[_Factor]) -> tuple[list[_Factor], bool]:
    """Take the root of factors if all of them are squares, and tell if they are."""
    squared = all(f.exponent % 2 == 0 for f in factors)
    if not squared:
        return factors, False
    return [f._replace(exponent=f.exponent // 2) for f in factors], True


def _motion(text: str, factors: list[_Factor]) -> tuple[str, float, bool]:
    """Tell which motion factors of length and time are, its unit in SI, and if it is squared."""
    factors, squared = _without_square(factors)
    whole = _product_of(factors)
    key = (whole.powers.get("length", 0), whole.powers.get("time", 0))
    lengths = [f for f in factors if "length" in f.powers]
    times = {f.exponent > 0 for f in factors if "length" not in f.powers}
    if not lengths:
        return "", 1.0, False
    # One length, over times alone: of m/s/m or g mm nobody knows the meaning.
    if key not in MOTIONS or len(lengths) > 1 or lengths[0].exponent != 1 or times - {False}:
        raise _asked(text, "may mean several things" if len(lengths) > 1 else "is of no motion")
    return MOTIONS[key], whole.size, squared


def _other(text: str, factors: list[_Factor]) -> tuple[str, float, bool]:
    """Tell which quantity a unit is of that is no motion."""
    factors, squared = _without_square(factors)
    whole = _product_of(factors)
    names = [u.unit for f in factors for u in f.units]
    if {"degree", "radian"} & set(names):
        return ("angle" if len(names) == 1 else "another quantity"), whole.size, squared
    like = {n: UnitProduct.from_unit(PrefixedUnit("", n)).powers for n in QUANTITIES}
    same = [QUANTITIES[n] for n, powers in like.items() if powers == whole.powers]
    return (same[0] if same else "another quantity"), whole.size, squared
