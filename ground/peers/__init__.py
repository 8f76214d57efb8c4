"""Libraries of others, asked the same questions; each runs in an interpreter of its own."""
