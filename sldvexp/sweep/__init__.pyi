from .shared_steps import Store as Store
from .sweep import Sweep as Sweep
