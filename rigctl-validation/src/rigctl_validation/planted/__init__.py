"""The tier ``discovery``: terms that are in no library, planted on the separate bench and searched for."""
