"""dgl_physics."""
