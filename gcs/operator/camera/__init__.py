"""A MAVLink camera that tracks: QGroundControl and others select by it, and see what is tracked."""
