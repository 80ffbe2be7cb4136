"""What the data itself says about a run: views compared with one another, mistakes named.

`examine_views` compares the images of all views before a field is made of them. To add a kind of
mistake, add a explanation to `diagnosis`, its sentence to `wording` and its repair to `repairs`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
