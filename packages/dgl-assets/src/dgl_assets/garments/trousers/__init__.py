"""Trousers and shorts."""
