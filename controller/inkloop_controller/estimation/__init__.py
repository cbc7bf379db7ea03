"""What scans tell about the surface and the ink."""
