from .compression import compress as compress
from .compression import slices as slices
from .rest import tell_rest as tell_rest
from .streamed import joined_blocks as joined_blocks
from .streamed import stream_field as stream_field
