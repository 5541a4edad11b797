"""Flights past fires as they are: smoke that leans, grows, hides its foot, moves or is many; `study scenes` calls it."""
