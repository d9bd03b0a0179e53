"""The run folder: raw data first, an append-only log, and a manifest that proves it unchanged."""
