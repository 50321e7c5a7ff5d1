"""From a mesh to a better one: problems, terms, the solver and its guard."""
