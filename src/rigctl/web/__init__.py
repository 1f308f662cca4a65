"""The project in a browser: `rigctl serve`, a local server over what the commands call too.

A part of the page is one module here and one script of the same name in ``assets``; `rigctl.web.parts` lists
them, `rigctl.web.answer` is how a module answers, `rigctl.web.jobs` does what takes long, and
`rigctl.web.gate` stands before all of them.
"""
