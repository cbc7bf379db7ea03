"""The page of a run: one HTML file with maps, curves and tables; or the same page, live while a part is printed."""
