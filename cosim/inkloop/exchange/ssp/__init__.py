"""Systems of FMUs for other tools: SSP, and the files of libcosim, Maestro and Simulink."""

FORMATS = ("ssp", "osp", "maestro")
"""Files of `inkloop export ssp`."""
VERSIONS = {"1.0": "2", "2.0": "3"}
"""Version of SSP -> version of FMI of our FMUs in it, unless configured otherwise."""
