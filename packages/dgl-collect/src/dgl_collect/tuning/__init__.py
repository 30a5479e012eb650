"""Search for better parameters of a demonstration in simulation."""
