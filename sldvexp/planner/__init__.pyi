from . import circle_limits as circle_limits
from . import circle_lines as circle_lines
from . import figure as figure
from . import files as files
from .planned import StandPlan as StandPlan
from .planned import check_stands as check_stands
from .planned import next_stand as next_stand
from .planned import plan as plan
