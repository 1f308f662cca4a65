"""Programs that compute a part of a model, an FMU or a user's functions, in processes of their own."""
