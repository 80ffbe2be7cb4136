from .bench import Bench as Bench
from .board import Board as Board
from .server import Server as Server
