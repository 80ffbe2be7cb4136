"""Command profiles: what cannot be said, and which file and key is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from sldvexp import errors
from sldvexp.errors import UserError
from sldvexp.instrument.profile import CHANNELS
from sldvexp.instrument.profile_file import load_profile, profile_path
from sldvexp.instrument.protocol import CHANNELS as PROTOCOL
from sldvexp.instrument.visa import Visa

CONF = Path(__file__).parents[2] / "conf"
SOURCE = (CONF / "profile" / "virtual_lab.yaml").read_text()
VIEW = 'view: {lab: ["VIEW {view}"]}'
RESOURCE = "TCPIP::127.0.0.1::5025::SOCKET"


@pytest.mark.parametrize("name", [p.stem for p in (CONF / "profile").glob("*.yaml")])
def test_every_profile_that_comes_with_the_program(name):
    by_name, by_path = load_profile(name), load_profile(f"conf://profile/{name}.yaml")
    assert by_name == by_path
    assert by_name.tried_on_hardware == (name == "virtual_lab")


def test_channels_are_those_of_the_protocol():
    assert CHANNELS == PROTOCOL


MISTAKES = {
    "unknown key": ("settle:", "setle:", "setle is not a known setting; did you mean settle?"),
    "unknown key below": (
        "  ask: DATA?",
        "  aks: DATA?",
        r"data.aks is not a known setting; did y",
    ),
    "unknown group": (
        "  move:",
        "  moves:",
        "commands.moves is not a known setting; did you mean m",
    ),
    "missing command": (
        '  home: {lab: ["MIRR:HOME"]}\n',
        "",
        r"commands.home is missing: give the command that sends the mirrors home",
    ),
    "missing value": ("  ask: DATA?\n", "", "data.ask must be given"),
    "missing below": ("      ask: SYST:ERR?\n", "", "devices.lab.errors.ask must be given"),
    "never off": (
        '  generator_off: {lab: ["GEN:OUTP 0"]}\n',
        "",
        "commands.generator_off is missing: what turns the generator on must be able to turn it",
    ),
    "bad placeholder": (
        "POS {up_down},",
        "POS {updown},",
        r"commands.move.lab\[0\] has the unknown placeholder {updown}; did you mean up_down\? Va",
    ),
    "placeholder of another group": (
        "MIRR:HOME",
        "MIRR:HOME {stream}",
        r"commands.home.lab\[0\] has the unknown placeholder {stream}; none is allowed here",
    ),
    "code": (
        "RATE {rate}",
        "RATE {rate.__class__}",
        r"commands.configure.lab\[0\] has the unknown placeholder {rate.__class__}; did you mean",
    ),
    "unfinished": (
        "POS {up_down},",
        "POS {up_down,",
        r"commands.move.lab\[0\] is no command that can be fi",
    ),
    "bad format": (
        "RATE {rate}",
        "RATE {rate:d}",
        r"commands.configure.lab\[0\] is no command .* 'd'",
    ),
    "nowhere": (",{left_right}", "", r"commands.move must have a command with {left_right}"),
    "no samples": (
        ', "SAMP:COUN {samples}"',
        "",
        r"commands.configure must have a command with {samples}",
    ),
    "no rate": (
        '"SAMP:RATE {rate}", ',
        "",
        r"commands.configure must have a command with {rate} or {interval} or {interval_us}",
    ),
    "unknown device": (
        "move: {lab:",
        "move: {lba:",
        "commands.move.lba addresses the unknown device lba; did you mean lab?",
    ),
    "data of nobody": (
        "  device: lab\n  ask: DATA",
        "  device: x\n  ask: DATA",
        "data.device address",
    ),
    "verified by nobody": (
        "device: lab\n    ask: LAS",
        "device: adc\n    ask: LAS",
        r"verify\[1\].device addresses the unknown device adc; Valid: lab",
    ),
    "wrong type": ("type: int16", "type: int12", "data.type cannot be int12; did you mean int16?"),
    "wrong order": ("order: little", "order: up", "data.order cannot be up; .*Valid: big, little"),
    "wrong header": ("header: ieee", "header: 4", "data.header cannot be 4; Valid: ieee, none"),
    "wrong number": ("settle: 0.0", "settle: soon", "settle must be a number, not soon"),
    "negative": ("settle: 0.0", "settle: -1", "settle must be zero or a positive number, not -1"),
    "wrong truth": (
        "hardware: true",
        "hardware: maybe",
        "tried_on_hardware cannot be maybe; Valid: false, true",
    ),
    "channels": (
        "[velocity, reference]",
        "[velocity, velocity]",
        "data.channels must be velocity and reference in the block's order",
    ),
    "no scale": ("  scale: CHAN:SCAL?", "", "data.scale is missing: give either scale, a quest"),
    "two scales": (
        "  scale: CHAN:SCAL?",
        "  scale: CHAN:SCAL?\n  volts_per_count: {velocity: 1, reference: 1}",
        "data.scale is missing: give either",
    ),
    "half a scale": (
        "  scale: CHAN:SCAL?",
        "  volts_per_count: {velocity: 1}",
        "data.volts_per_count.reference is missing",
    ),
    "scale of nothing": (
        "  scale: CHAN:SCAL?",
        "  volts_per_count: {velocity: 1, referenc: 1, reference: 1}",
        "data.volts_per_count.referenc is not a channel; did you mean reference?",
    ),
    "no volts": (
        "  scale: CHAN:SCAL?",
        "  volts_per_count: {velocity: 0, reference: 1}",
        "data.volts_per_count.velocity must be a positive number, not 0",
    ),
    "no expression": (
        "'([-+]?",
        "'([-+?",
        r"devices.lab.errors.answer is not a regular expression",
    ),
    "no code": (
        r"'([-+]?\d+)\s*(,.*)?'",
        r"'[-+]?\d+.*'",
        "devices.lab.errors.answer must have the code in par",
    ),
    "endless": ('answer_end: "\\n"', 'answer_end: ""', "devices.lab.answer_end must be given"),
    "a text for a list": (
        VIEW,
        "view: {lab: VIEW}",
        r"commands.view.lab must be a list, as in \[a",
    ),
    "a list for a table": (VIEW, "view: [VIEW]", "commands.view must be a table, as in {name: val"),
    "nothing": (VIEW, "view:", "commands.view must be a table, as in {name: value}"),
    "a list in a list": (
        VIEW,
        "view: {lab: [[a]]}",
        r"commands.view.lab\[0\] must be one value, not",
    ),
    "no numbers": ("settle: 0.0", "settle:", "settle must be a number, not empty"),
    "half a line": (
        "banner: 0 ",
        "banner: 0.5 ",
        "devices.lab.banner must be a whole number, not 0.5",
    ),
    "fewer than no lines": ("banner: 0 ", "banner: -1 ", "devices.lab.banner must be"),
    "no device": (
        "  lab:\n    identify",
        "  lab: x\n  x:\n    identify",
        "devices.lab must be a tabl",
    ),
    "twice": ("settle: 0.0", "settle: 0.0\nsettle: 1.0", r"line \d+: .* settle is there twice"),
    "not yaml": ("settle: 0.0", "settle: 0.0: [", r"line \d+: is not a profile: "),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_one_sentence_names_the_file_and_the_key(tmp_path, mistake):
    right, wrong, told = MISTAKES[mistake]
    assert SOURCE.count(right) in (1, 2)
    file = tmp_path / "mine.yaml"
    file.write_text(SOURCE.replace(right, wrong, 1))
    with pytest.raises(UserError, match=rf"^{file}(, |: )(.*; )?{told}") as error:
        Visa(RESOURCE, str(file))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["", "- a\n- b", "just text", "1.5"])
def test_a_file_that_is_something_else(tmp_path, text):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(
        UserError, match=rf"^{file}: is not a profile: it must be a table of settings"
    ):
        load_profile(str(file))


def test_all_mistakes_are_told_at_once(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(SOURCE.replace("{up_down}", "{up}").replace("settle: 0.0", "settle: -1"))
    with pytest.raises(UserError, match=r"settle must be .*; commands.move.lab\[0\] has the unkn"):
        load_profile(str(file))


def test_words_that_yaml_takes_for_something_else(tmp_path):
    """A command OFF is not a false, and 1e3 is a number."""
    file = tmp_path / "mine.yaml"
    text = SOURCE.replace('["MIRR:HOME"]', "[OFF, 007, ~]").replace("settle: 0.0", "settle: 1e-3")
    file.write_text(text)
    profile = load_profile(str(file))
    assert profile.commands.home == {"lab": ["OFF", "007", "~"]}
    assert profile.settle == 0.001


def test_profiles_that_are_not_there(tmp_path):
    with pytest.raises(
        UserError, match=r"^there is no profile iotec; did you mean iotech\? Valid: i"
    ):
        Visa(RESOURCE, "iotec")
    with pytest.raises(UserError, match=r"mine.yaml: there is no such profile"):
        profile_path(str(tmp_path / "mine.yaml"))


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"timeout": 0.0}, "timeout: must be a positive number"),
        ({"retries": -1}, "retries: must be 0 or more, not -1"),
        ({"backend": "@ni"}, "backend: cannot be @ni; .*Valid: @ivi, @py"),
        ({"resource": 5}, "resource: must be VISA's name of a device"),
        ({"resource": {}}, "resource: must be VISA's name of a device"),
        ({"resource": {"adc": "GPIB::1"}}, "must name lab, the devices of the profile virtual_lab"),
        (
            {"profile": "iotech"},
            "resource: must name dac and adc, the devices of the profile iotech",
        ),
    ],
)
def test_settings_that_cannot_be(settings, told):
    with pytest.raises(UserError, match=told):
        Visa(**{"resource": RESOURCE, **settings})


def test_one_resource_may_be_named(tmp_path):
    assert Visa({"lab": RESOURCE}).takes_views_itself
    plugin = Visa({"dac": "GPIB0::9::INSTR", "adc": "GPIB0::14::INSTR"}, "iotech")
    assert not plugin.takes_views_itself
    assert plugin.inputs() == [str(CONF / "profile" / "iotech.yaml")]


def test_names_that_are_known_are_compared_with_no_others(monkeypatch):
    """Which is slow, and said of wrong ones alone."""
    monkeypatch.setattr(errors, "_slips", None)
    assert load_profile("virtual_lab").commands.move
