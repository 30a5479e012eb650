"""dgl_sadp."""
