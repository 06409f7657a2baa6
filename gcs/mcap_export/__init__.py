"""Flights for other programs: MCAP, as Foxglove reads it."""
