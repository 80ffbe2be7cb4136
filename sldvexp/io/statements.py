"""Statements on the values of a file that stand in its free text, as ``Velocity [mm/s] RMS``.

A line is cut into words, each of which is a quantity (in common languages), a unit, a measure of
amplitudes, a word that says nothing of its own, as *values*, or a stranger. It states something if
these stand beside one another, as a quantity and its unit do, or if it has no strangers. A word for
averages, ranges, sensors, references or errors makes the measure or the unit beside it one of these
and not of the values, as in ``RMS averaging`` and ``velocity range 50 mm/s/V``; such a part of a
line states nothing, as do parts that name two quantities.

Assumed is that text which is not understood means nothing: statements are compared with what is
known of values otherwise, and never replace it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, TypeVar

from sldvexp.unit_labels import (
    AMPLITUDES,
    Amplitude,
    SpectralForm,
    UnitLabel,
    UnitNotUnderstoodError,
    read_unit,
    same_unit,
)

#: Words for a quantity, by what they begin with.
QUANTITIES: dict[str, tuple[str, ...]] = {
    "displacement": (
        *("displacement", "auslenkung", "schwingweg", "verschiebung", "wegamplitude"),
        *("déplacement", "deplacement", "desplazamiento", "spostamento", "deslocamento"),
        *("verplaatsing", "перемещен", "変位", "位移"),
    ),
    "velocity": (
        *("velocit", "velocidad", "velocidade", "geschwindigkeit", "schwinggeschwindigkeit"),
        *("schwingschnelle", "schnelle", "vitesse", "snelheid", "скорост", "速度"),
    ),
    "acceleration": (
        *("acceleration", "beschleunigung", "schwingbeschleunigung", "accélération"),
        *("aceleración", "aceleracion", "accelerazione", "aceleração", "versnelling"),
        *("ускорен", "加速度"),
    ),
    # Per unit of a reference: their names are those of response functions.
    "receptance": ("receptance", "compliance", "nachgiebigkeit"),
    "mobility": ("mobility", "admittance", "mobilität"),
    "accelerance": ("accelerance", "inertance", "akzeleranz"),
}
#: Quantity of the response whose response function has a name of its own.
RESPONSES = {
    "receptance": "displacement",
    "mobility": "velocity",
    "accelerance": "acceleration",
}
PLACES = (
    *("coordinat", "koordinat", "coordonn", "coordenad", "position", "geometr", "géométr", "xyz"),
)
PHASE = ("phase", "phasen", "fase", "фаза", "位相", "相位")
UNIT_KEYS = {
    *("unit", "units", "einheit", "einheiten", "unité", "unités", "unidad", "unidades", "unità"),
    *("eenheid", "unidade", "in", "en"),
}
#: Words that say nothing of their own.
FILLING = {
    *(
        "a",
        "all",
        "and",
        "are",
        "as",
        "at",
        "be",
        "by",
        "for",
        "from",
        "given",
        "has",
        "have",
        "is",
    ),
    *("it", "of", "on", "per", "the", "these", "this", "to", "was", "were", "with", "over", "each"),
    *("der", "die", "das", "des", "alle", "sind", "ist", "und", "als", "mit", "von", "angegeben"),
    *("de", "la", "le", "les", "du", "des", "el", "los", "las", "del", "di", "della", "valeurs"),
    *(
        "valores",
        "valori",
        "werte",
        "wert",
        "value",
        "values",
        "data",
        "daten",
        "result",
        "results",
    ),
    *("amplitude", "amplitudes", "amplituden", "magnitude", "magnitudes", "betrag", "ampl", "mag"),
    *("signal", "signals", "channel", "kanal", "vib", "vibration", "vibrations", "vibrometer"),
    *("schwingung", "vibrational", "out-of-plane", "in-plane", "out", "plane", "surface", "line"),
    *("spectrum", "spectra", "spektrum", "spectral", "fft", "frf", "h1", "h2", "hv", "response"),
    *("function", "functions", "domain", "complex", "real", "imag", "imaginary", "part", "parts"),
    *("type", "quantity", "kind", "ordinate", "abscissa", "axis", "y-axis", "z-axis", "column"),
    *(
        "columns",
        "table",
        "scale",
        "scaling",
        "scaled",
        "level",
        "normal",
        "component",
        "direction",
    ),
    *("x", "y", "z", "measured", "measurement", "messung", "point", "points", "punkt", "scan"),
    *("shape", "mode", "deflection", "operating", "ods", "time", "record", "histories", "history"),
    *("plate", "beam", "disc", "disk", "shell", "panel", "platte", "balken", "front", "back"),
    *("frequency", "frequenz", "hz", "khz", "si", "view", "left", "right", "top", "bottom"),
    *(
        "format",
        "exported",
        "export",
        "ascii",
        "file",
        "measure",
        "detector",
        "expressed",
        "written",
    ),
}
#: Words with which a measure or a unit is of something else than the values, by their beginnings.
ELSEWHERE = (
    *("averag", "avg", "mittel", "moyenn", "promedi", "medi", "mean", "hold", "detect", "linear"),
    *("range", "bereich", "messbereich", "gamme", "rango", "campo", "sensitiv", "empfindlich"),
    *("sensib", "decoder", "dekoder", "encoder", "sensor", "transducer", "aufnehmer", "pickup"),
    *("accelerometer", "filter", "noise", "rausch", "bruit", "resolution", "auflös", "limit"),
    *(
        "max",
        "min",
        "trigger",
        "generator",
        "excitation",
        "anregung",
        "window",
        "fenster",
        "search",
    ),
    *("pick", "marker", "cursor", "overload", "error", "fehler", "erreur", "deviation", "abweich"),
    *("residual", "residuum", "fit", "align", "calib", "kalib", "uncertain", "unsicher", "accura"),
    *(
        "genau",
        "sound",
        "schall",
        "wave",
        "welle",
        "group",
        "flow",
        "wind",
        "air",
        "speed",
        "scann",
    ),
    *("operator", "author", "user", "serial", "folder", "path", "full-scale", "fullscale", "gain"),
    *("input", "output", "voltage", "spannung", "force", "kraft", "source", "quelle", "integrat"),
    *("differenti", "convert", "compar", "vergl", "estimat", "threshold", "schwelle", "tolerance"),
    *("software", "version", "licen", "option", "board", "lens", "laser", "stand-off", "standoff"),
    *("not", "no", "nicht", "without", "ohne", "instead", "crest", "factor", "width", "ratio"),
    *("bandwidth", "quality", "confidence", "controller", "controlled", "alarm", "setpoint"),
    *("zero-padd", "peaks", "resonan", "tracking", "correct", "old", "previous", "subset"),
)
#: Words behind which a reference stands.
REFERENCES = re.compile(r"\b(?:ref(?:erence|erenz)?[\s_]*\d*|versus|vs|relative to)\b\.?", re.I)
#: A response over its reference, both in words.
OVER = re.compile(r"(?<=[^\W\d_]{4})\s*/\s*(?=[^\W\d_]{4})|\s+[/&*]\s+(?=[^\W\d_]{4})")
#: A name of a file or a place of one.
FILE_NAME = re.compile(
    r"\S*[\\]\S*|\S*\w/\w+/\w+/\S*|\b[\w.-]+\.(?!m\b|s\b)[a-z]{2,4}\b(?!\.)", re.I
)
#: Measures in several languages; the longer come first.
_PEAK = r"(?:spitze(?:nwert)?|scheitel(?:wert)?|cr[êe]te|pico|picco|valle)"
_RMS = (
    r"effektivwerte?|(?:valeurs?\s+)?efficaces?|(?:valor(?:es)?\s+)?efi?caz(?:es)?|efficaci"
    r"|root[\s-]mean[\s-]square|quadratische[rn]?\s+mittelwerte?"
)
MEASURES = (
    *((one, rf"(?<![^\W_])(?:{words})(?![^\W_])") for one, words in AMPLITUDES),
    (Amplitude.peak_to_peak, rf"\b{_PEAK}(?:\s*-\s*|\s+(?:zu|à|a)\s+){_PEAK}\b|\bpeak\W+valley\b"),
    (Amplitude.rms, rf"\b(?:{_RMS})\b"),
    (Amplitude.peak, rf"\b{_PEAK}\b"),
)
#: A number with a unit behind it is an amount, as of a range.
AMOUNT = re.compile(
    r"(?<![\w^])[+-]?\d[\d.,]*(?:e[+-]?\d+)?[ij]?\s*[)\]]*\s*(?P<unit>[^\W\d_][^\s,;:()\[\]]*|%)",
    re.I,
)
AMOUNTS = {"angle", "voltage", "current", "force", "pressure", "power", "velocity", "acceleration"}
#: Beginning of what may be a unit of a motion, an angle, or of `AMOUNTS`.
LIKE_A_UNIT = re.compile(
    r"\W*(?:\S*[/²³⁻^*·√]|(?:[nµμumck]?m|in|inch(?:es)?|ft|feet|foot|mils?|thou|microns?"
    r"|(?:milli|micro|nano|centi)?-?met(?:er|re)s?|ips|fps|kine|g(?:n|ee|rms)?|[munkM]?(?:V|N|A|W|Pa)"
    r"|lbf?|bar|rad(?:ian)?s?|deg(?:ree)?s?|°|[munck]?m\.?s)(?![^\W\d_])|m?V(?:pp|pk|rms)\b)", re.I,
)  # fmt: skip
#: Words of a line, with their brackets.
WORD = re.compile(r"[\[(][^\[\]()]*[\])]|\x00\w+\x00|[^\s,;:=()\[\]\"]+|[:=]")
#: Peaks that are none of an amplitude, and velocities that are none of a surface.
OTHER = re.compile(
    r"\bpeaks?\W+(?:at|freq\w*|no|nr|\d+|near|around|of|power|list|table|is|was)\b"
    r"|\b(?:first|second|third|main|highest|this)\s+peak\b|\bphase\s+velocit", re.I,
)  # fmt: skip
#: Words for the unit of coordinates.
LENGTH_UNIT = re.compile(r"\blength[\s-]+units?\b|\bunits?\s+of\s+length\b|\blängeneinheit\b", re.I)
#: Blanks around the stroke of a unit.
STROKE = re.compile(
    r"(?<![^\W_])((?:[nµμumck]?m|in|inch|ft|mils?))\s*/\s*(s(?:ec)?[²2]?|s\^2)(?![^\W_])"
)
#: Time dependence of complex values, as ``exp(-i w t)``.
TIME_DEPENDENCE = re.compile(
    r"(?:exp|\be)\s*\^?\s*[({\[]?\s*(?P<sign>[+−-]?)\s*[ij]\s*[*·]?\s*"
    r"(?:ω|w|omega|2\s*[*·]?\s*(?:π|pi)\s*[*·]?\s*f)\s*[*·]?\s*t\b", re.I,
)  # fmt: skip
#: Sense of positive values.
POSITIVE = re.compile(
    r"\bpositive?\b[^.;]{0,40}?\b(?P<way>towards?|away\s+from)\s+(?:the\s+)?"
    r"(?P<what>laser|vibrometer|instrument|sensor|scan(?:ning)?|head|surface|object|structure)",
    re.I,
)
ON_SURFACE = ("surface", "object", "structure")


@dataclass(frozen=True)
class Statement:
    """Meaning of the text of a line, as far as it states any; empty or None where it does not.

    Parameters
    ----------
    quantity : str
        ``displacement``, ``velocity`` or ``acceleration``.
    unit : UnitLabel or None
        Of the values.
    amplitude : Amplitude or None
    length : UnitLabel or None
        Of coordinates.
    angle : str
        Unit of phases, ``degree`` or ``radian``.
    phase : str
        ``exp_plus`` or ``exp_minus``.
    positive : str
        ``towards`` or ``away``, seen from the surface.
    """

    quantity: str = ""
    unit: UnitLabel | None = None
    amplitude: Amplitude | None = None
    length: UnitLabel | None = None
    angle: str = ""
    phase: str = ""
    positive: str = ""

    def __bool__(self) -> bool:
        """Whether anything is stated."""
        return self != NOTHING

    def joined(self, other: Statement) -> Statement:
        """Join two statements of a line; what they contradict each other in says nothing."""
        made = self
        for field in fields(self):
            mine, its = getattr(self, field.name), getattr(other, field.name)
            if its and mine != its:
                taken: Any = field.default if mine else its
                made = replace(made, **{field.name: taken})
        return made


NOTHING = Statement()


@dataclass(frozen=True)
class Known:
    """Meaning of a file's values by settings and labels; None where it is not known or needless.

    Parameters
    ----------
    quantity : str or None
    factor : float or None
        One of the values' unit in SI.
    amplitude : Amplitude or None
    length : float or None
        One of the coordinates' unit in m.
    angle : str or None
        Unit of phases.
    phase, positive : str or None
    """

    quantity: str | None = None
    factor: float | None = None
    amplitude: Amplitude | None = None
    length: float | None = None
    angle: str | None = None
    phase: str | None = None
    positive: str | None = None

    def contradictions(self, said: Statement) -> dict[str, str]:
        """Find what a statement contradicts, by the setting, with what is stated there."""
        found: dict[str, str] = {}
        unit = said.unit
        quantity = said.quantity or (unit.quantity if unit else "")
        if quantity and self.quantity not in (None, quantity):
            found["quantity"] = quantity
        elif unit and self.factor is not None and not same_unit(unit.factor, self.factor):
            found["unit"] = unit.text
        for name in ("amplitude", "angle", "phase", "positive"):
            stated, known = getattr(said, name), getattr(self, name)
            if stated and known is not None and stated != known:
                found[name] = SHOWN.get(stated, stated)
        if (
            said.length
            and self.length is not None
            and not same_unit(said.length.factor, self.length)
        ):
            found["length_unit"] = said.length.text
        return found


#: Words for measures, and their spelling in units.
SPELLINGS = {Amplitude.rms: "rms", Amplitude.peak: "pk", Amplitude.peak_to_peak: "p-p"}
SHOWN = {one: one.name.replace("_", " ") for one in Amplitude}


#: Different lines that are looked at, and characters of a line that may state something.
MOST_LINES, LONGEST = 1000, 400
Place = TypeVar("Place")


def distinct(lines: Iterable[tuple[Place, str]]) -> Iterator[tuple[Place, str]]:
    """Give lines with their places, once if they differ in numbers alone, and not too many.

    Examples
    --------
    >>> list(distinct([(1, "point 1"), (2, "point 2"), (3, "rms")]))
    [(1, 'point 1'), (3, 'rms')]
    """
    seen: set[str] = set()
    for place, line in lines:
        template = re.sub(r"\d+", "0", line)
        if template not in seen and len(seen) < MOST_LINES:
            seen.add(template)
            yield place, line


def shown(line: str) -> str:
    """Shorten a line for a message."""
    text = " ".join("".join(c if c.isprintable() else " " for c in line).split())
    return repr(text if len(text) < 60 else f"{text[:57]}...")


@lru_cache(maxsize=512)
def statement_in(line: str) -> Statement:
    """Tell what a line of free text states of the values of its file.

    Examples
    --------
    >>> said = statement_in("Vib Velocity [mm/s] RMS")
    >>> said.quantity, said.unit.factor, said.amplitude.name
    ('velocity', 0.001, 'rms')
    >>> bool(statement_in("RMS averaging, velocity range 50 mm/s/V"))
    False
    """
    if len(line) > LONGEST:
        return NOTHING
    if match := POSITIVE.search(line):
        at_instrument = match["what"].lower() not in ON_SURFACE
        towards = match["way"].lower().startswith("toward") is at_instrument
        return Statement(positive="towards" if towards else "away")
    if match := TIME_DEPENDENCE.search(line):
        return Statement(phase="exp_minus" if match["sign"] in ("-", "−") else "exp_plus")
    found = NOTHING
    for part in _parts(line):
        found = found.joined(_of_part(part))
    return found


def _parts(line: str) -> Iterator[str]:
    """Cut a line at semicolons, bars, ends of sentences, and tabs that part more than a key."""
    for piece in re.split(r"[;|]|(?<=[^\W\d_]{3})\.\s+(?=[A-ZÄÖÜ])", line):
        cells = [cell for cell in piece.split("\t") if cell.strip()]
        key = ""
        for cell in cells if len(cells) > 2 else ["\t".join(cells)]:
            key += f" {cell}"
            if not cell.rstrip().endswith((":", "=")):
                yield key
                key = ""
        if key:
            yield key


def _of_part(text: str) -> Statement:
    """Tell what a part of a line states."""
    text = text.replace("\x00", " ")  # which marks measures below
    text = FILE_NAME.sub(" ", text).replace("_", " ").replace("'", " ")
    text = OVER.split(REFERENCES.split(text)[0])[0]
    text = STROKE.sub(r"\1/\2", LENGTH_UNIT.sub("coordinates unit", text))
    if OTHER.search(text) or any(_is_amount(match["unit"]) for match in AMOUNT.finditer(text)):
        return NOTHING
    words = list(_words(text))
    if any(kind == "elsewhere" for kind, _ in words):
        return NOTHING
    return _of_words(words)


def _is_amount(unit: str) -> bool:
    """Tell whether a word behind a number makes it the amount of a range or a level."""
    if unit == "%" or unit.lower() in ("db", "g", "mv", "v"):
        return True
    label = _unit(unit)
    return label is not None and label.quantity in AMOUNTS


def _words(text: str) -> Iterator[tuple[str, object]]:
    """Tell the kind and the meaning of each word."""
    for k, (_, pattern) in enumerate(MEASURES):
        text = re.sub(pattern, f" \x00{k}\x00 ", text, flags=re.I)
    text = re.sub(r"(?<![^\W_])([gG])(?=\s*\x00)", r"[\1]", text)
    before = ""
    for match in WORD.finditer(text):
        word = match[0]
        if word.startswith("\x00"):
            yield "measure", MEASURES[int(word.strip("\x00"))][0]
        elif word[0] in "[(":
            inner = re.sub(r"\x00(\d+)\x00", lambda m: SPELLINGS[MEASURES[int(m[1])][0]], word)
            label = _unit(inner[1:-1].strip())
            if label is not None:
                yield ("angle" if label.quantity == "angle" else "unit"), label
            else:
                yield from _words(word[1:-1])
        else:
            yield _kind(word.strip(".-–"), before in UNIT_KEYS or before in (":", "="))
        before = word.lower()


def _kind(word: str, after_key: bool) -> tuple[str, object]:
    """Tell kind and meaning of one word; single letters are units only behind a word for them."""
    small = word.lower()
    if re.fullmatch(r"[#%!/&:=+-]*[\d.,]*([+-]?r?[xyz])?", small):
        return "filling", None
    for quantity, stems in QUANTITIES.items():
        if small.startswith(stems):
            return "quantity", RESPONSES.get(quantity, quantity)
    if small in UNIT_KEYS and not (after_key and small == "in"):
        return "key", None
    if small.startswith(PLACES):
        return "places", None
    if small in PHASE or small in ("phases", "phasenwinkel"):
        return "phase", None
    if small in FILLING and not (after_key and small == "s"):
        return "filling", None
    label = _unit(word)
    if label is not None and (len(word) > 1 or after_key):
        return ("angle" if label.quantity == "angle" else "unit"), label
    if any(small.startswith(stem) for stem in ELSEWHERE):
        return "elsewhere", None
    return "stranger", None


@lru_cache(maxsize=512)
def _unit(word: str) -> UnitLabel | None:
    """Understand a word as a unit of a motion or an angle; None if it is none."""
    if not LIKE_A_UNIT.match(word):  # most words are none
        return None
    angles = {"radians": "rad", "degrees": "deg", "degree": "deg", "radian": "rad"}
    try:
        label = read_unit(angles.get(word.lower(), word))
    except UnitNotUnderstoodError:
        return None
    plain = label.form is SpectralForm.linear and not label.product
    return label if plain and (label.is_motion or label.quantity in ("angle", *AMOUNTS)) else None


def _of_words(words: Iterable[tuple[str, object]]) -> Statement:
    """Tell what words state that are none of something else than the values."""
    listed = [(kind, value) for kind, value in words if value is not None or kind != "filling"]
    strangers = any(kind == "stranger" for kind, _ in listed)
    quantities = {value for kind, value in listed if kind == "quantity"}
    if len(quantities) > 1:
        return NOTHING
    found, subject, beside = Statement(), "", ""
    for kind, value in listed:
        near = beside in ("quantity", "unit", "measure", "key")
        if kind in ("places", "phase"):
            subject = kind
        elif kind == "quantity":
            subject = kind
            if not strangers or beside in ("unit", "measure"):
                found = replace(found, quantity=str(value))
        elif kind == "angle" and subject == "phase" and isinstance(value, UnitLabel):
            found = replace(found, angle="degree" if value.factor != 1.0 else "radian")
        elif kind == "unit" and isinstance(value, UnitLabel):
            if subject == "places" and strangers and beside not in ("places", "key"):
                continue
            found = _with_unit(found, value, subject, near and (bool(subject) or not strangers))
            subject = "quantity" if found.unit is value else subject
            if found.unit is value and quantities:
                found = replace(found, quantity=str(next(iter(quantities))))
        elif isinstance(value, Amplitude) and (
            not strangers or near or value is Amplitude.peak_to_peak
        ):
            found = found.joined(Statement(amplitude=value))
            if beside == "quantity" and quantities:
                found = replace(found, quantity=str(next(iter(quantities))))
        beside = beside if kind == "key" and beside else kind
    return found


def _with_unit(found: Statement, label: UnitLabel, subject: str, near: bool) -> Statement:
    """Add a unit to a statement, as that of its subject."""
    length = label.quantity == "displacement" and not label.reference
    if subject == "places":
        return replace(found, length=label) if length and label.amplitude is None else found
    if not label.is_motion or (subject not in ("quantity", "") and not near):
        return found
    if length and subject != "quantity" and label.amplitude is None:
        return found  # of what nobody knows
    if found.unit is not None and not same_unit(found.unit.factor, label.factor):
        return replace(found, unit=None)
    return replace(found, unit=label, amplitude=label.amplitude or found.amplitude)
