"""JSON Schemas (draft-07) of plans, benches and datasets, generated from the models."""

from station.schema.text import KINDS, schema_text

__all__ = ["KINDS", "schema_text"]
