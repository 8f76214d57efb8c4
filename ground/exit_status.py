"""Exit statuses of commands, beside 0 for done and those of `ground.__main__`."""

STOPPED = 130  # after an interrupt, as of a shell; what was finished is kept
