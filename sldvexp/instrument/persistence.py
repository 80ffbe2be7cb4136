"""Steps that are repeated over a new connection when something disturbs them."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from sldvexp.instrument.connection import DisturbanceError
from sldvexp.instrument.dialogue import Dialogue
from sldvexp.instrument.protocol import InstrumentError

log = logging.getLogger(__name__)

#: Pause before the connection is made again, s; twice as long every further time.
PAUSE = 0.1

T = TypeVar("T")


class Persistence:
    """Does steps of a dialogue; one that was disturbed is repeated as a whole.

    Parameters
    ----------
    connect : callable
        Begins a dialogue.
    restore : callable
        Brings an instrument that was just connected to where the program believes it is.
    retries : int
        How often a step is repeated.
    """

    def __init__(
        self, connect: Callable[[], Dialogue], restore: Callable[[Dialogue], None], retries: int
    ) -> None:
        self._connect = connect
        self._restore = restore
        self._retries = retries
        self._dialogue: Dialogue | None = None

    def __call__(self, what: str, step: Callable[[Dialogue], T]) -> T:
        """Do a step.

        Parameters
        ----------
        what : str
            What is being done, for messages.
        step : callable

        Raises
        ------
        InstrumentError
            If the instrument refuses, or the step was disturbed every time.
        """
        for attempt in range(self._retries + 1):
            try:
                return self._once(step)
            except DisturbanceError as error:
                if attempt == self._retries:
                    tried = f"{attempt + 1} times" if attempt else "once"
                    raise InstrumentError(f"{what}: {error} (tried {tried})") from error
                log.warning("%s: %s; trying again", what, error)
                time.sleep(PAUSE * 2**attempt)
            except InstrumentError as error:
                raise InstrumentError(f"{what}: {error}") from error
        raise AssertionError

    def hang_up(self) -> None:
        """End the dialogue."""
        if self._dialogue is not None:
            self._dialogue.close()
            self._dialogue = None

    def _once(self, step: Callable[[Dialogue], T]) -> T:
        """Do a step, over a new connection if the last step left the old one in disorder."""
        known, self._dialogue = self._dialogue, None
        dialogue = known or self._connect()
        in_order = False
        try:
            if known is None:
                self._restore(dialogue)
            done = step(dialogue)
            in_order = True
            return done
        except DisturbanceError:
            raise
        except InstrumentError:
            # A refusal leaves nothing unread; whatever else may, also an operator's Ctrl-C.
            in_order = known is not None
            raise
        finally:
            if in_order:
                self._dialogue = dialogue
            else:
                dialogue.close()
