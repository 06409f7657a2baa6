"""The operator's page: what a browser sees of a station, and steers by it."""
