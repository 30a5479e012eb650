"""Pictures of triangle meshes, drawn on the CPU, with positions and segments of pixels."""
