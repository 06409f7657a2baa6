"""What it costs here: `gcs bench` measures everything that takes time, side by side in one run."""
