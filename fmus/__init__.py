"""The built FMUs: fmi3/, fmi3-fixed/ and fmi2/ hold one file per model."""
