"""Readers of real orbits, one file format a module; `read.read_orbit` knows which one a file needs."""
