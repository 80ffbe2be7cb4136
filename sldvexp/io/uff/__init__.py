"""Universal files: data sets of modal analysis, as text and binary, of any program.

Begin with `universal_file`, which opens one as a `UniversalFile`: the headers of its functions, its
geometry and its units at once, values on demand. From below upward, `source` has bytes and data
sets, `fortran` numbers in columns, `functions`, `nodal` and `geometry` a kind of data set each,
`index` finds them, and `writer` writes them. A new data set to read is a function there and a
property of `UniversalFile`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
