"""A scenario as LayerJob.fmu: one block that prints it, with scalar inputs and outputs."""
