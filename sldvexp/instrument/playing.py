"""What a profile's commands are filled with to play anything but sines, and to take its records."""

from __future__ import annotations

from string import Formatter
from typing import Any

from sldvexp.instrument.profile import Profile
from sldvexp.instrument.protocol import Acquisition, InstrumentError
from sldvexp.signal import ExcitationKind, RecordDesign

#: Kinds that one record, played over and over, is not.
NOISE = (ExcitationKind.random, ExcitationKind.burst_random)


def in_words(acquisition: Acquisition) -> str:
    """Say what the generator plays.

    Examples
    --------
    >>> in_words(Acquisition(rate=1000.0, samples=100, excitation=(50.0, 60.0)))
    '50, 60 Hz'
    """
    if acquisition.drive is None:
        return ", ".join(f"{f:g}" for f in acquisition.excitation) + " Hz"
    e = acquisition.drive.excitation
    low, high = e.band
    return f"{e.kind.name} from {low:g} to {high:g} Hz in records of {acquisition.samples} samples"


def require_playable(profile: Profile, kind: ExcitationKind) -> None:
    """Refuse what the profile has no commands for, before anything is sent.

    Raises
    ------
    InstrumentError
        That says what is missing.
    """
    asked = _placeholders(profile)
    name = kind.name
    if not asked:
        raise InstrumentError(
            f"the instrument cannot play {name}: its profile has no commands.play; give them, or "
            "choose scan.sampling.excitation=sine"
        )
    if "function" in asked and name not in profile.functions:
        raise InstrumentError(
            f"the instrument cannot play {name}: its profile has no functions.{name}; it has "
            f"{', '.join(profile.functions) or 'none'}"
        )
    if "function" not in asked and kind in NOISE:
        raise InstrumentError(
            f"the instrument plays a waveform of one record over and over, which {name} noise is "
            "not; choose scan.sampling.excitation=pseudo_random"
        )


def played_by(profile: Profile, design: RecordDesign) -> dict[str, Any]:
    """Give the values of the placeholders of ``commands.play``."""
    e = design.excitation
    values: dict[str, Any] = {
        "function": profile.functions.get(e.kind.name, ""),
        "low": e.band[0],
        "high": e.band[1],
        "lines": e.lines.name,
        "seed": e.seed,
        "burst": e.burst,
        "samples": design.samples,
        "amplitude": e.amplitude,
    }
    if "waveform" in _placeholders(profile):
        values["waveform"] = ",".join(f"{v:.6g}" for v in design.waveform())
    return values


def records_of(acquisition: Acquisition) -> dict[str, Any]:
    """Give the values of the placeholders of ``commands.records``."""
    a = acquisition
    trigger = "generator" if a.triggered else "free"
    return {"records": a.records, "lead": a.lead, "trigger": trigger, "samples": a.samples}


def _placeholders(profile: Profile) -> set[str]:
    texts = [text for texts in profile.commands.play.values() for text in texts]
    return {name for text in texts for _, name, _, _ in Formatter().parse(text) if name}
