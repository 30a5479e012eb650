"""Tops."""
