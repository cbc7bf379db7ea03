"""Systems of FMUs as other tools read and write them: SSP, and the files of libcosim, Maestro and Simulink."""
