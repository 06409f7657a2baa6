"""The ground control station: joins video, tracker, control and vehicle."""
