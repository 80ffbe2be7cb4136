"""An operator's console: a page in the browser from which a session is aimed, scanned and watched.

One thread is the bench's: it owns the instrument, aims and scans (`AimingBench`, `Scanning`).
Another serves the page and speaks with the browsers (`Server`); one of them controls, the others
watch. Between the two stand a `NoticeBoard`, on which browsers read, and a queue of the
controller's wishes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
