from . import messages as messages
from . import security as security
from .sources import Origins as Origins
