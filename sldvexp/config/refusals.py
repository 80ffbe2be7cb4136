"""OmegaConf's refusals of keys and values, in the words of this program."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

from omegaconf import Node, OmegaConf
from omegaconf.errors import (
    ConfigAttributeError,
    ConfigKeyError,
    ConfigTypeError,
    KeyValidationError,
    OmegaConfBaseException,
    ValidationError,
)

from sldvexp.errors import nearest

#: What is said of a key that `names_code`.
NO_CODE = "is refused: a configuration names plugins and cannot name code"

#: What a setting of each type must be.
MUST = {
    bool: "must be true or false, not {0}",
    float: "must be a number, not {0}",
    int: "must be a whole number, not {0}",
    str: "must be text, not {0}",
}

#: What OmegaConf tells in words only, and what a user is told; the pattern's groups fill it.
WORDS = (
    (r"Merge error: \w+ is not a subclass of \w+\. value: (.*)",
     "has an entry {0} that must be a table, as in {{name: value}}"),
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
    for pattern, words in WORDS:
        if match := re.fullmatch(pattern, text):
            return words.format(*match.groups())
    if isinstance(error, ConfigKeyError | ConfigAttributeError):
        return _unknown_key(error)
    if isinstance(error, KeyValidationError):
        numbered = error.parent_node._metadata.key_type is int
        wrong, right = ("name", "numbers") if numbered else ("number", "names")
        return f"has a {wrong} where the others have {right}"
    if isinstance(error, ValidationError) and error.parent_node is not None:
        return _wrong_value(error)
    if isinstance(error, ConfigTypeError) and error.key is not None:
        return "cannot be deleted, only changed"
    if text.startswith("Cannot merge"):
        return _wrong_shape(error)
    return f"is refused: {text}"


def _wrong_value(error: ValidationError) -> str:
    """Say that a value is not of the type of its place."""
    value, place = error.value, error.child_node
    if value is None or (isinstance(value, Node) and value._is_none()):
        return "must have a value, not null"
    table = error.parent_node
    kind = table._metadata.element_type if place is None else place._metadata.ref_type
    if kind is float and re.fullmatch(r"[-+]?\.inf", str(value)):
        return f"must be a number; infinity is written {value.replace('.', '')} here"
    if kind in MUST:
        return MUST[kind].format(value)
    if inspect.isclass(kind) and issubclass(kind, Enum):
        if isinstance(value, bool) and (word := _read_as(value)) in kind.__members__:
            return f"must be in quotes, '{word}': YAML reads the bare word as {str(value).lower()}"
        return f"cannot be {value}; {nearest(str(value), kind.__members__)}"
    return _wrong_shape(error)


def _read_as(value: bool) -> str:
    """Name the word that YAML reads as a truth value, if a choice has that name."""
    return "on" if value else "off"


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
