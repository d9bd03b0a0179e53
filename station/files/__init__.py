"""Files that people write: read strictly, checked, and every fault with its place."""
