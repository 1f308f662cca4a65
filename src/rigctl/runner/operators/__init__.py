"""Who answers a run's questions and ends it: the terminal, another terminal, the browser, or nobody."""
