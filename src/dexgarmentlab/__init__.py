"""dexgarmentlab."""
