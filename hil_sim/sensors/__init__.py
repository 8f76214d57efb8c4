"""What the satellite's sensors make of the truth, before anything goes wrong on the way."""
