"""Flights past fires as they are: smoke that leans, grows, hides its foot, moves or is many; for `study scenes`."""
