from . import cached_loader as cached_loader
from . import hydra_plugin as hydra_plugin
from . import messages as messages
from . import mixed_tables as mixed_tables
from . import schema as schema
from . import security as security
from .sources import Origins as Origins
