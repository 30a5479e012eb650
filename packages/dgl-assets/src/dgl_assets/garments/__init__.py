"""Generators of garments, one subpackage a family."""
