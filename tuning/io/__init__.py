"""Files: atomic writers, CSV, pages."""
