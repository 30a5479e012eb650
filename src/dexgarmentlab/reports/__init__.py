"""Pages that show what was run: HTML that needs nothing but its folder."""
