"""The whole chain of a flight on a video, with no vehicle and no link: as a batch, or steered in the page."""
