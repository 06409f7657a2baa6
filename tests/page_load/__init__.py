"""What the operator's page costs: served with a station that is not there, looked at by many."""
