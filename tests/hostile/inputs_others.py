"""Hostile instruments behind a socket, and packages of others with plugins that fail."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from inputs import Hostile

MEASURE = (
    "~experiment report=none scan=rectangle 'scan.views={a: {corners: [[0, 0], [0, 9], [9, 9], "
    "[9, 0]]}}' scan.pixels=[2,2] scan.sampling.samples=128 signal=sine_fit instrument=visa "
    "instrument.resource=TCPIP::127.0.0.1::<port>::SOCKET instrument.timeout=0.3 "
    "instrument.retries=0"
)


def always(answer: bytes, times: int = 1) -> Callable[[Any], None]:
    """Answer every question alike."""

    def talk(client: Any) -> None:
        while client.recv(4096):
            for _ in range(times):
                client.sendall(answer)

    return talk


def after_identity(answer: bytes, times: int = 1) -> Callable[[Any], None]:
    """Say who it is, and answer everything else alike."""

    def talk(client: Any) -> None:
        while said := client.recv(4096):
            if b"IDN" in said:
                client.sendall(b"sldvexp,virtual lab,0,1\n")
                continue
            for _ in range(times):
                client.sendall(answer)

    return talk


def slowly(client: Any) -> None:
    """A byte now and then, and never the end of a line."""
    client.recv(4096)
    while True:
        client.sendall(b"s")
        time.sleep(0.1)


def unasked(client: Any) -> None:
    """Talk without end before anything is asked."""
    while True:
        client.sendall(b"banner\n" * 100)


def hang_up(client: Any) -> None:
    """Close at once."""
    client.close()


def drops(client: Any) -> None:
    """Answer as the virtual lab up to the samples, which come byte by byte."""
    answers = {
        b"CHAN:SCAL?": b"1e-3,1e-3\n",
        b"SAMP:RATE?": b"25600\n",
        b"SYST:ERR?": b'0,"No error"\n',
    }
    answers[b"*IDN?"] = b"sldvexp,virtual lab,0,1\n"
    while said := client.recv(4096):
        for question in said.splitlines():
            if question in answers:
                client.sendall(answers[question])
            elif question.endswith(b"?"):
                while True:
                    client.sendall(b"#")
                    time.sleep(0.05)


DEVICES: dict[str, Callable[[Any], None]] = {
    "an endless line": always(b"x" * 2**16, 10**6),
    "an endless line after its name": after_identity(b"x" * 2**16, 10**6),
    "a byte now and then": slowly,
    "talk before all questions": unasked,
    "hangs up": hang_up,
    "samples now and then": drops,
    "zeros": always(bytes(1000)),
    "escape codes": always(b"\x1b[2J\x1b]0;owned\x07\n"),
    "a name of 1 MB": always(b"sldvexp" + b"x" * 2**20 + b"\n"),
    "errors without end": after_identity(b'-113,"Undefined header"\n'),
    "errors of 1 MB": after_identity(b'-113,"' + b"x" * 2**20 + b'"\n'),
    "a code of 5000 digits": after_identity(b"-" + b"1" * 5000 + b',"x"\n'),
    "a block for an error": after_identity(b"#9999999999"),
    "bytes that are no text": after_identity(b"\xff\xfe\xfd\n"),
    "nothing": after_identity(b""),
}
INPUTS = [
    Hostile("instrument", name, MEASURE, {}, "", device=device) for name, device in DEVICES.items()
]

START = """
from dataclasses import dataclass
from sldvexp.registry import register
from sldvexp.reconstruction.base import Reconstruction
"""
METHOD = (
    START
    + """
@register("reconstruction", "evil")
@dataclass
class Evil(Reconstruction):
    '''A method.'''
    size: int = 1
"""
)
CHOSEN = "experiment=point reconstruction=evil report=none"
BAD = {
    "cannot be imported": "import nothing_of_the_kind",
    "ends the program": "import sys; sys.exit(3)",
    "ends the program with words": "import sys; sys.exit('x\\n' * 100)",
    "is no Python": "(",
    "recurses": "def f(): f()\nf()",
    "has a broken error": "class E(Exception):\n    def __str__(self): raise ValueError\nraise E",
    "has an error of 1 MB": "raise ValueError('x' * 2**20)",
    "has escape codes": "raise ValueError('\\x1b[2J')",
    "registers nothing": "",
    "registers in no group": START + "@register('nope', 'evil')\n@dataclass\nclass Evil: pass",
    "registers what is none": START + "register('reconstruction', 'evil')(3)",
    "takes a name of ours": METHOD.replace("evil", "absolute"),
    "has a field that cannot be": METHOD.replace("size: int = 1", "size: complex = 1j"),
    "has a field without a type that is known": METHOD.replace("size: int = 1", "size: 'Nope' = 1"),
}
FAILING = {
    "fails at once": "    def __post_init__(self): 1 / 0",
    "ends the program at once": "    def __post_init__(self): raise SystemExit(3)",
    "recurses at once": "    def __post_init__(self): self.__post_init__()",
    "has a broken error": "    def __post_init__(self):\n        class E(Exception):\n            def __str__(self): raise ValueError\n        raise E",
    "fails with many lines": "    def __post_init__(self): raise ValueError('a\\n\\x1b[2Jb\\n' * 1000)",
    "is asked for what it lacks": "    def __getattribute__(self, name): raise KeyError(name)",
    "fails when asked": "    def reconstruct(self, *a, **k): 1 / 0\n    estimate = solve = rows_of = combine = reconstruct",
    "ends the program when asked": "    def reconstruct(self, *a, **k): raise SystemExit('x')\n    estimate = solve = rows_of = combine = reconstruct",
    "gives nothing": "    def reconstruct(self, *a, **k): return None\n    estimate = solve = rows_of = combine = reconstruct",
    "lacks what is abstract": "    pass",
}
INPUTS += [
    Hostile("plugin", name, CHOSEN, {}, "", packages={"stranger": code})
    for name, code in BAD.items()
]
INPUTS += [
    Hostile(
        "plugin",
        f"beside, {name}",
        "experiment=pose seed=-1 pose=nope",
        {},
        "there is no pose=nope",
        packages={"stranger": code},
    )
    for name, code in list(BAD.items())[:6]
]
INPUTS += [
    Hostile(
        "plugin",
        f"chosen, {name}",
        CHOSEN,
        {},
        "the package stranger",
        packages={"stranger": METHOD + code},
    )
    for name, code in FAILING.items()
]
