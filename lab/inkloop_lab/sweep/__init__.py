"""Studies: one scenario printed with many settings and seeds, in processes or on a Dask cluster, and what matters.

`study` reads STUDY.toml, `plan` says what to print next, `engine` prints it, `folder` keeps a record of each print,
`dataset` writes all of them into one file. Only the process that was started writes into the folder of a study.
"""
