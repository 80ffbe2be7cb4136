from .console import Console as Console
