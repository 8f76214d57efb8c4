"""What a tick, a kernel and a start cost: `ground timing`."""
