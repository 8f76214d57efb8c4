"""Tuning: from flown errors to a table set whose bound holds, by whatever method, with the evidence beside it."""
