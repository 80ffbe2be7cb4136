"""Schemas and files of the program that were read before, without the modules that they are of.

A composed configuration is shown, not run: of a plugin's class only the schema counts. Schemas are
made of the dataclasses once for a state of the program and kept in the user's cache. There and in
what is read of it a class that is not loaded has a stand-in: a class of the same name, and of the
same members if it is an enumeration. Nothing made of stand-ins leaves the composition; what cannot
be composed with them is composed of the classes themselves.

Measured is a fifth of the processor time of ``--cfg job`` with choices that were never shown before
(median of 38 pairs 0.80, of the first two choices of a state of the program 0.92). All of it goes
with `ShowingLoader`, `RememberingRepository.table` and the argument `shown` of `remembering`.
"""

from __future__ import annotations

import importlib
import io
import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, is_dataclass
from enum import Enum
from functools import cache
from operator import attrgetter
from typing import Any

import hydra
import omegaconf
from omegaconf import basecontainer, dictconfig

from sldvexp.config.kept import KeptFiles, name_of

#: The package whose classes have stand-ins.
OWN = f"{__name__.partition('.')[0]}."

#: A class as it is kept: its module and name, and the members of an enumeration.
ClassName = tuple[str, str, tuple[tuple[str, Any], ...] | None]


@dataclass
class StandIn:
    """Base of all stand-ins of dataclasses, by which OmegaConf takes them for such."""


def _is_loaded(module: str) -> bool:
    return module in sys.modules


@cache
def _class_of(module: str, name: str, members: tuple[tuple[str, Any], ...] | None) -> type:
    """Find a class if it is loaded, or make its stand-in; the same one in all of a process."""
    if _is_loaded(module):
        found: type = attrgetter(name)(sys.modules[module])
        return found
    if members is not None:
        make: Any = Enum  # whose call checkers of types do not follow
        enumeration: type = make(name, dict(members), module=module, qualname=name)
        return enumeration
    return type(name.rpartition(".")[2], (StandIn,), {"__module__": module, "__qualname__": name})


class _Pickler(pickle.Pickler):
    """Writes names in the places of the program's classes, and notes the dataclasses."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.dataclasses: set[type] = set()

    def persistent_id(self, obj: Any) -> ClassName | None:
        """See `pickle.Pickler`."""
        if not isinstance(obj, type) or not obj.__module__.startswith(OWN):
            return None
        if issubclass(obj, Enum):
            values = ((name, member.value) for name, member in obj.__members__.items())
            members = tuple((n, v if isinstance(v, int | str) else n) for n, v in values)
            return obj.__module__, obj.__qualname__, members
        if is_dataclass(obj):
            self.dataclasses.add(obj)
            return obj.__module__, obj.__qualname__, None
        return None

    def reducer_override(self, obj: Any) -> Any:
        """See `pickle.Pickler`; members have names, but values of classes that may not be there."""
        if isinstance(obj, Enum) and type(obj).__module__.startswith(OWN):
            return getattr, (type(obj), obj.name)
        return NotImplemented


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, pid: ClassName) -> type:
        """See `pickle.Unpickler`."""
        return _class_of(*pid)


class SchemaTable:
    """What was read for compositions that are shown, by what it is of.

    Anything but an entry of `read` is made anew; `keep` puts what is new into the user's cache.
    """

    def __init__(self) -> None:
        self._files = KeptFiles()
        self._name = name_of("schemas", hydra.__version__, omegaconf.__version__)
        self._entries: dict[str, bytes] = {}
        self._new = False
        if content := self._files.read(self._name):
            with suppress(Exception):  # the cache holds something else under this name
                self._entries = pickle.loads(content)

    def read(self, key: str, make: Callable[[], Any]) -> Any:
        """Give a new copy of an entry, made with `make` if there is none.

        Raises
        ------
        Exception
            What `make` raises, or pickling what it makes.
        """
        if key not in self._entries:
            self._add(key, make())
        return _Unpickler(io.BytesIO(self._entries[key])).load()

    def keep(self) -> None:
        """Write the entries, if some are new."""
        if self._new:
            self._files.write(self._name, pickle.dumps(self._entries))
            self._new = False

    def _add(self, key: str, value: Any) -> None:
        written = io.BytesIO()
        pickler = _Pickler(written)
        pickler.dump(value)
        self._entries[key], self._new = written.getvalue(), True
        for kind in pickler.dataclasses:
            entry = _entry_of(kind)
            if entry not in self._entries:  # a table of such settings makes more of them
                self._add(entry, _usual(kind))

    @contextmanager
    def of_classes(self) -> Iterator[None]:
        """Let OmegaConf take the fields of stand-ins from here; it asks the class itself.

        Raises
        ------
        LookupError
            If this version of OmegaConf has another way.
        """

        def data_of(of: Any, allow_objects: bool | None = None) -> Any:
            if not isinstance(of, type) or not issubclass(of, StandIn):
                return _usual(of, allow_objects)
            return self.read(_entry_of(of), lambda: _usual(_loaded(of), allow_objects))

        modules: tuple[Any, ...] = (basecontainer, dictconfig)
        if _usual is None or not all(hasattr(m, _usual.__name__) for m in modules):
            raise LookupError("this OmegaConf asks for the fields of a class in another way")
        try:
            for module in modules:
                module.get_structured_config_data = data_of
            yield
        finally:
            for module in modules:
                module.get_structured_config_data = _usual


#: What gives OmegaConf the fields of a class; it is no part of what OmegaConf promises.
_usual: Any = getattr(dictconfig, "get_structured_config_data", None)


def _entry_of(kind: type) -> str:
    """Name the entry of a class' fields."""
    return f"class {kind.__module__} {kind.__qualname__}"


def _loaded(kind: type) -> type:
    """Load the class that a stand-in stands for."""
    found: type = attrgetter(kind.__qualname__)(importlib.import_module(kind.__module__))
    return found
