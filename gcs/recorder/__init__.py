"""Everything a flight leaves behind, written so that nothing of it can hold the flight up."""
