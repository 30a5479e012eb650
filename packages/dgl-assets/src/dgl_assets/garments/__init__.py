"""Garments: patterns, meshes, correspondence and the catalogue.

Each family has a subpackage; the modules here are shared.
"""
