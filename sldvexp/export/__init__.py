"""Results in the formats of other programs, one format a file.

`Export` is the contract, `velocities_of` what all formats write, and `export_all` writes every
format of a run. A new format is a file here and its line in `sldvexp.config.registry`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
