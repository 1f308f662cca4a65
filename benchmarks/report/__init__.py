"""Time and size of a page about the whole campaign, compared with plotly's writer."""
