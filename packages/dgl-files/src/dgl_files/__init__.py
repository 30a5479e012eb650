"""Typed fields, whole files and checked tensors, for all packages that read and write files."""
