"""Studies of the GNSS consistency test, and the same test on files of real receivers."""
