"""Evaluation of methods on tasks: which there are, their episodes on worker processes, and their results."""
