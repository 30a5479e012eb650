"""dgl_tasks."""
