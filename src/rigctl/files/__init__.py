"""Files a user writes and files rigctl writes: YAML with positions, validation, schema, atomic writing."""
