"""Garments: patterns, meshes, correspondence and the catalogue.

`garment`, `sewing`, `meshing`, `correspondence` and `catalogue` are shared; each family has a subpackage.
"""
