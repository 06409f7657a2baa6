"""Closed-loop scenarios: the real station in simulated time, and the table every change is measured by."""
