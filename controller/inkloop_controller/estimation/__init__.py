"""Estimate the surface and the ink from scans."""
