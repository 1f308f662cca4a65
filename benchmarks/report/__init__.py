"""How long a page about the whole campaign takes, and how large it is, beside plotly's own writer."""
