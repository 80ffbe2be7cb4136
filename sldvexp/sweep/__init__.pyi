from .job import perform as perform
from .lock import alone as alone
from .plan import register_resolver as register_resolver
from .shared_steps import Store as Store
from .sweep import Sweep as Sweep
from .sweep import leave_sign as leave_sign
