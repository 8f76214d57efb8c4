"""How accurate the flight models are against real orbits, and what they cost."""
