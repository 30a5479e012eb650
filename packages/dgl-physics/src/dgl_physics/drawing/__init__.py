"""Pictures of triangle meshes, drawn on the processor; and what their pixels show."""
