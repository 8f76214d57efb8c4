"""Tables in flight: the stimulus that a certificate carries, and the store of active and inactive images."""
