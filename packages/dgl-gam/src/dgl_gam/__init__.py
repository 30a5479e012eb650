"""dgl_gam."""
