"""A recorded flight flown again: the same code, what came from outside as it was recorded, no link and no clock."""
