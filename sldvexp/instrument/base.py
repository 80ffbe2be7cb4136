"""What every plugin of the group `instrument` that can scan has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from typing import Any, ClassVar

from sldvexp.instrument.protocol import Instrument
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.targets.base import Target


class ScanningPlugin(ABC):
    """Base of the instruments that scan; `open` is what they add.

    Attributes
    ----------
    real : bool
        Whether mirrors move; what only tries a configuration out leaves such an instrument alone.
    """

    real: ClassVar[bool] = True

    @property
    def takes_views_itself(self) -> bool:
        """Whether `open` puts the instrument where a view is; otherwise somebody must move it."""
        return True

    def inputs(self) -> list[str]:
        """Files that are read besides the configuration."""
        return []

    @abstractmethod
    def open(
        self,
        scene: Any,
        laser: TwoMirror,
        target: Target | None = None,
        seed: int = 0,
        view: str = "",
    ) -> AbstractContextManager[Instrument]:
        """The instrument in one view; leaving it sends the mirrors home, the generator off.

        Parameters
        ----------
        scene : Scene or None
            Of the virtual lab; only a simulation looks at it.
        laser : TwoMirror
        target : Target, optional
        seed : int
            Of everything random in a simulation.
        view : str
            Empty stays where the instrument is.
        """
