"""`gcs`: the command line. `args_*` say what may be given, the others do it and show what came of it."""
