"""A measuring session: views one after the other, everything kept line by line.

`sldvexp.session.session` goes through the views of a scan and gives the groups of the dataset;
`Camera` makes complex pixels of scan lines, and `Journal` keeps the lines so that a session that
was cut off goes on where it was. A further kind of scan part is a function in a file of its own,
named in the table `KINDS` there.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
