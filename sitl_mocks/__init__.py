"""A vehicle, a camera and a world to test against. Imports none of the code under test."""
