"""How programs are compiled and kept, and how several processes share the work."""
