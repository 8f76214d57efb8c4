"""A constellation of navigation satellites: orbits, who sees whom, ranges between them, what they broadcast wrongly."""
