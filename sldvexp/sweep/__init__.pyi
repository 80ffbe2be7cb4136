from . import job as job
from . import lock as lock
from . import plan as plan
from . import sweep as sweep
from .shared_steps import Store as Store
from .sweep import Sweep as Sweep
