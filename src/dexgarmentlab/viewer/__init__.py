"""Viewer in the browser: garments, tasks and episodes in 3D."""
