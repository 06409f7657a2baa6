"""The whole station flown in simulated time against the mocked vehicle: no sockets, no threads, always the same."""
