"""Results in words: the one place where findings become sentences, tables and next commands.

The rooms below return values and decide; nothing there is meant to be read. Here a result becomes an answer
of blocks (`rigctl.answers.blocks`): all wording, plurals, digits and display thresholds. The rooms above
render blocks, each in one way: on a terminal (`rigctl.cli.blocks`) and on a page (`rigctl.report.blocks`).
"""
