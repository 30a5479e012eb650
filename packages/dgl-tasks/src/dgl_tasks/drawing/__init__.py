"""Pictures of triangle meshes, drawn on the processor."""
