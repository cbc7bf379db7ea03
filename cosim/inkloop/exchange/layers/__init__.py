"""Results for other programs: bitmaps of the layers for print heads, surfaces as meshes and height maps."""

BITMAP_FORMATS = ("tiff", "png", "bmp")
"""Files of `inkloop export layers`."""
DROP_SPLITS = ("planes", "bits")
"""Forms of drops of several sizes in bitmaps of one bit: a bitmap for each size, or for each bit of the level."""
MESH_FORMATS = ("stl", "glb")
MAP_FORMATS = ("sdf", "x3p", "tiff", "npy")
