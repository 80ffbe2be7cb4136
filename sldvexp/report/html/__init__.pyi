from . import run_page as run_page
from . import sweep_page as sweep_page
from . import unfinished as unfinished
