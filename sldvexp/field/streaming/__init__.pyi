from .compression import compress as compress
from .streamed import stream_field as stream_field
