"""Flights that another station recorded."""
