"""Files that users or rigctl write: YAML with positions, validation, JSON Schema, atomic writing."""
