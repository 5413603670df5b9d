"""Reference paths, and the heading that they ask for."""
