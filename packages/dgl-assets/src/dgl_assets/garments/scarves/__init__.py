"""Scarves."""
