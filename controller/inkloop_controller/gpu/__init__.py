"""The search of plans on a graphics processor, by OpenCL."""
