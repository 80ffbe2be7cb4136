"""Hardware that scans, and recordings of it.

`Instrument` is the protocol that the rest of the program knows: configure, excite, move, acquire,
scan. A plugin of the group `instrument` that scans extends `ScanningPlugin`, whose `open` gives an
instrument in one view. ``instrument=visa`` speaks to hardware as a profile in ``conf/profile/``
says; `Replay` reads the scan lines that a run kept. What failed is told by `InstrumentError`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
