"""OmegaConf's refusals of keys and values, in the words of this program."""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sldvexp.errors import nearest

#: What is said of a key that `names_code`.
NO_CODE = "is refused: a configuration names plugins and cannot name code"

#: What OmegaConf says, and what a user is told; the pattern's groups fill the sentence.
WORDS = (
    (r"Value '([-+]?)\.inf' .*", "must be a number; infinity is written {0}inf here"),
    (r"Value '(.*)' of type '\w+' could not be converted to Float", "must be a number, not {0}"),
    (r"Value '(.*)' of type '\w+' could not be converted to Integer",
     "must be a whole number, not {0}"),
    (r"Value '(.*)' is not a valid bool.*", "must be true or false, not {0}"),
    (r"Cannot convert '\w+' to string: '(.*)'", "must be text, not {0}"),
    (r"field '.*' is not Optional|Incompatible value 'None' .*|.* value: None",
     "must have a value, not null"),
    (r"Invalid value assigned: (\w+) is not a ListConfig, list or tuple\.",
     "must be a list, as in [a, b]"),
    (r"Key '?(.*?)'? \(\w+\) is incompatible with \(int\)",
     "has a name where the others have numbers"),
    (r"Merge error: \w+ is not a subclass of \w+\. value: (.*)",
     "has an entry {0} that must be a table, as in {{name: value}}"),
    (r"\w+(?: \(DictConfig\))? does not support deletion", "cannot be deleted, only changed"),
    (r"Interpolation key '(.*)' not found", "refers to ${{{0}}}, but there is no {0}"),
    (r"Unsupported interpolation type (.*)",
     "refers to ${{{0}:...}}, but there is no resolver {0}"),
    (r"\w+ raised while resolving interpolation: \"?(.*?)\"?", "cannot be resolved: {0}"),
    (r"MissingMandatoryValue while resolving interpolation: .*",
     "refers to a value that must be given first"),
)  # fmt: skip


def names_code(key: str) -> bool:
    """Tell whether a key is one by which Hydra finds something to call, such as ``_target_``."""
    return key.startswith("_") and key.endswith("_")


def refusal(error: OmegaConfBaseException) -> str:
    """Say what is wrong with the key or value of an error, as the rest of a sentence."""
    text = str(error.msg or error).splitlines()[0]
    text = re.sub(r"^While dereferencing interpolation '.*?': ", "", text)
    if re.fullmatch(r"Key '.*' (not in '\w+'|is not in struct)", text):
        return _unknown_key(error)
    if match := re.fullmatch(r"Invalid value '(.*)', expected one of \[(.*)\]", text):
        return f"cannot be {match[1]}; {nearest(match[1], match[2].split(', '))}"
    for pattern, words in WORDS:
        if match := re.fullmatch(pattern, text):
            return words.format(*match.groups())
    if re.match(r"Cannot (merge|assign)|Invalid type assigned", text):
        return _wrong_shape(error)
    return f"is refused: {text}"


def _unknown_key(error: OmegaConfBaseException) -> str:
    """Say that a schema does not know a key, or that a table does not have the entry yet."""
    if names_code(str(error.key)):
        return NO_CODE
    schema = error.object_type
    if is_dataclass(schema):
        names = [f.name for f in fields(schema)]
        return f"is not a known setting; {nearest(str(error.key), names)}"
    there: Any = error.parent_node
    entries = map(str, there) if OmegaConf.is_dict(there) and not there._is_none() else []
    return f"is not there; {nearest(str(error.key), entries)}".removesuffix("; there are none")


def _wrong_shape(error: OmegaConfBaseException) -> str:
    """Say that a list, a table or a single value stands in the place of another."""
    node: Any = error.parent_node
    if error.key is not None and OmegaConf.is_dict(node):
        node = node._get_node(error.key) if error.key in node else node
    schema = OmegaConf.get_type(node) if OmegaConf.is_config(node) else None
    if OmegaConf.is_list(node):
        return "must be a list, as in [a, b]"
    if is_dataclass(schema):
        names = ", ".join(f.name for f in fields(schema))
        return f"must be a table of the settings {names}, as in {{name: value}}"
    return "must be a table, as in {name: value}"
