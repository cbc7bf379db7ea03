"""A deposition model that follows a real printer, and compares its surface with the scans."""
