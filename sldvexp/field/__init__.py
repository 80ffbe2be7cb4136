"""The velocity field over a volume: what each view sees of it, and the solution of all of it.

Begin with `estimate_field`: views made of arrays (`View.from_arrays`), a laser, a volume and a
method give a `FieldResult`, whose `to_dataset` makes the group ``field`` of a run. A run goes the
same way, from its own groups (`estimate.volume_visibility`, `estimate.reconstruct`).

In the order of the data: `visibility` projects the samples of a volume into the views' images,
`equations` makes normal equations of the samples' least squares, `solvers` solve them, `bounds`
says how far nodal values may be off because of noise, poses and elements, `fit` and `result` put
it together. `streaming` does the same for more frequencies than fit into memory.

A new solver is a file in `solvers` with one dataclass that extends `Solver`, has the one hook
`prepare` and is registered. Reconstruction methods are those of `sldvexp.reconstruction`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
