"""A stranger's client for MAVLink cameras that track: knows pymavlink and the MAVLink definitions, nothing of ours."""
