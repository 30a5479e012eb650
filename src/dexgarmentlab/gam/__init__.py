"""Affordance model on the command line: clouds, pictures and runs."""
