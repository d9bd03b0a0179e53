"""The instruments of a bench: opened, locked, and read whether they are at rest."""
