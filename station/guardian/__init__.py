"""A second process that makes the bench safe when the one that runs a plan dies or stands still."""
