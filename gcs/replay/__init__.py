"""A recorded flight again, in the page or as lines."""
