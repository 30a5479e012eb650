"""The policies of `dgl_sadp` as the laboratory uses them."""
