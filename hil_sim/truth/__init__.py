"""The true motion of the satellite, independent of everything that flies."""
