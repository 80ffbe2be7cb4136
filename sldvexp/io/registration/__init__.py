"""Registration data, object points and the mirror angles that reach them, in files.

Begin with `read`, which gives a `RegistrationTable` a view; `write` writes them, and `to_dataset`
and `from_dataset` turn them to the group ``/registration`` of a run and back. A new format is a
module with `read` and `write`, and a suffix in `sldvexp.io.registration.files.FORMATS`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
