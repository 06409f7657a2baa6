"""Pure logic of following: geometry, estimation, laws, state machine, gate. No I/O, no clock."""
