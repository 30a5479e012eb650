"""dgl_collect."""
