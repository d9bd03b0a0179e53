"""A recorded transcript served back to the drivers, and what they do differently."""
