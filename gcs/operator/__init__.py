"""Who tells the flight what to do: the terminal now, and anything else that speaks `Order`."""
