"""Fields of more frequencies than fit into memory, solved block by block."""
