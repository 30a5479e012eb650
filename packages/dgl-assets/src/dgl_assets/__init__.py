"""dgl_assets."""
