"""Evaluation of methods: attempts, figures, comparison."""
