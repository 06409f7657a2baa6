"""Which gains suit an airframe and a latency: the follow flown in simulated time with each, and the best named."""
