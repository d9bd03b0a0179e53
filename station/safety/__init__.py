"""What brings a bench to rest, watches its limits, and keeps a tripped one from being used."""
