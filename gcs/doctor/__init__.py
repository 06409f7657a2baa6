"""`gcs doctor`: checks of machine, configuration, video and vehicle, each saying what to fix."""
