"""Studies of the inter-satellite monitor: the paper's claims, detection, false alarms, a real day."""
