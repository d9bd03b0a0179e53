"""YAML files with the place of every key, read strictly and written plainly."""
